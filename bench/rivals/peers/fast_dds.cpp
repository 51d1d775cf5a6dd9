// SPDX-License-Identifier: Apache-2.0
// Frames over Fast DDS: send|receive best-effort|DEPTH|all PEER [LEASE_S]. DEPTH and all are
// reliable, with KEEP_LAST and KEEP_ALL; with LEASE_S a write waits for room however long that
// takes. Over UDP alone: network namespaces share the memory that it would take instead.
#if __has_include(<fastrtps/utils/IPLocator.h>)  // version 2
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>
#else
#define ORBBUF_FAST_DDS_3
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.hpp>
#include <fastdds/utils/IPLocator.hpp>
#endif
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TopicDataType.hpp>
#include <memory>
#include <string>

#include "bench/rivals/peers/messages.hpp"

namespace {

namespace fast = eprosima::fastdds::dds;
#ifdef ORBBUF_FAST_DDS_3
namespace rtps = eprosima::fastdds::rtps;
const auto kOk = fast::RETCODE_OK;
const auto kForever = fast::c_TimeInfinite;
#else
namespace rtps = eprosima::fastrtps::rtps;
const auto kOk = ReturnCode_t::RETCODE_OK;
const auto kForever = eprosima::fastrtps::c_TimeInfinite;
#endif
using orbbuf::bench::Message;

constexpr std::uint32_t kLargestFrame = 1 << 20;

constexpr std::size_t kLengthBytes = sizeof(std::uint32_t);

std::uint32_t size_of(const void* data) {
  return static_cast<std::uint32_t>(static_cast<const Message*>(data)->size() + kLengthBytes);
}

/// A message behind its length, as CDR has a sequence of octets: Fast DDS pads what it carries to a
/// multiple of 4 bytes.
bool write(const void* data, rtps::SerializedPayload_t& payload) {
  const auto& message = *static_cast<const Message*>(data);
  const auto length = static_cast<std::uint32_t>(message.size());
  std::memcpy(payload.data, &length, kLengthBytes);
  std::copy(message.begin(), message.end(), payload.data + kLengthBytes);
  payload.length = size_of(data);
  return true;
}

bool read(const rtps::SerializedPayload_t& payload, void* data) {
  std::uint32_t length = 0;
  if (payload.length < kLengthBytes) return false;
  std::memcpy(&length, payload.data, kLengthBytes);
  if (length > payload.length - kLengthBytes) return false;
  const rtps::octet* message = payload.data + kLengthBytes;
  static_cast<Message*>(data)->assign(message, message + length);
  return true;
}

class FrameType final : public fast::TopicDataType {
 public:
#ifdef ORBBUF_FAST_DDS_3
  FrameType() {
    set_name("Frame");
    max_serialized_type_size = kLargestFrame;
  }
  bool serialize(const void* data, rtps::SerializedPayload_t& payload,
                 fast::DataRepresentationId_t) override {
    return write(data, payload);
  }
  bool deserialize(rtps::SerializedPayload_t& payload, void* data) override {
    return read(payload, data);
  }
  std::uint32_t calculate_serialized_size(const void* data, fast::DataRepresentationId_t) override {
    return size_of(data);
  }
  void* create_data() override { return new Message; }
  void delete_data(void* data) override { delete static_cast<Message*>(data); }
  bool compute_key(rtps::SerializedPayload_t&, rtps::InstanceHandle_t&, bool) override {
    return false;
  }
  bool compute_key(const void*, rtps::InstanceHandle_t&, bool) override { return false; }
#else
  FrameType() {
    setName("Frame");
    m_typeSize = kLargestFrame;
  }
  bool serialize(void* data, rtps::SerializedPayload_t* payload) override {
    return write(data, *payload);
  }
  bool deserialize(rtps::SerializedPayload_t* payload, void* data) override {
    return read(*payload, data);
  }
  std::function<std::uint32_t()> getSerializedSizeProvider(void* data) override {
    return [data] { return size_of(data); };
  }
  void* createData() override { return new Message; }
  void deleteData(void* data) override { delete static_cast<Message*>(data); }
  bool getKey(void*, rtps::InstanceHandle_t*, bool) override { return false; }
#endif
};

class Printer final : public fast::DataReaderListener {
 public:
  void on_data_available(fast::DataReader* reader) override {
    Message message;
    fast::SampleInfo info;
    while (reader->take_next_sample(&message, &info) == kOk) {
      if (info.valid_data) orbbuf::bench::print_arrival(message.data(), message.size());
    }
  }
};

template <class Qos>
Qos quality(Qos qos, const std::string& history) {
  qos.endpoint().history_memory_policy = rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  qos.reliability().kind =
      history == "best-effort" ? fast::BEST_EFFORT_RELIABILITY_QOS : fast::RELIABLE_RELIABILITY_QOS;
  if (history == "best-effort") return qos;
  if (history == "all") {
    qos.history().kind = fast::KEEP_ALL_HISTORY_QOS;
  } else {
    qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
    qos.history().depth = std::stoi(history);
  }
  return qos;
}

fast::DomainParticipant* join(const char* peer, int lease_s) {
  fast::DomainParticipantQos qos;
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(
      std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>());
  rtps::Locator_t locator;
  rtps::IPLocator::setIPv4(locator, peer);
  qos.wire_protocol().builtin.initialPeersList.push_back(locator);
  if (lease_s > 0) qos.wire_protocol().builtin.discovery_config.leaseDuration = {lease_s, 0};
  return fast::DomainParticipantFactory::get_instance()->create_participant(0, qos);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  fast::DomainParticipant* participant = join(argv[3], argc > 4 ? std::stoi(argv[4]) : 0);
  const fast::TypeSupport type(new FrameType);
  type.register_type(participant);
  fast::Topic* topic = participant->create_topic("camera", "Frame", fast::TOPIC_QOS_DEFAULT);
  if (std::string(argv[1]) == "receive") {
    static Printer printer;
    participant->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT)
        ->create_datareader(topic, quality(fast::DATAREADER_QOS_DEFAULT, argv[2]), &printer);
    for (;;) ::pause();
  }
  auto qos = quality(fast::DATAWRITER_QOS_DEFAULT, argv[2]);
  if (argc > 4) qos.reliability().max_blocking_time = kForever;
  fast::DataWriter* writer =
      participant->create_publisher(fast::PUBLISHER_QOS_DEFAULT)->create_datawriter(topic, qos);
  for (;;) {
    Message message = orbbuf::bench::next_message();
    writer->write(&message);
  }
}
