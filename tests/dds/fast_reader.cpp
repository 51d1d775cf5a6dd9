// SPDX-License-Identifier: Apache-2.0
// A ROS 2 reader of Fast DDS's, which is another implementation than the server's:
// `orbbuf-fast-dds-reader FOLDER reliable|best-effort BASE...`.
#include <ros_messagesPubSubTypes.h>
#include <unistd.h>

#include <cstdlib>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/subscriber/qos/DataReaderQos.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <memory>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "tests/dds/received.hpp"

namespace {

namespace fast = eprosima::fastdds::dds;
using sensor_msgs::msg::dds_::CompressedImage_;

class ImageListener final : public fast::DataReaderListener {
 public:
  ImageListener(Received& received, std::mutex& mutex, std::string base)
      : received_(received), mutex_(mutex), base_(std::move(base)) {}

  void on_data_available(fast::DataReader* reader) override {
    CompressedImage_ image;
    fast::SampleInfo info;
    while (reader->take_next_sample(&image, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      const std::scoped_lock lock(mutex_);
      const auto& stamp = image.header().stamp();
      received_.keep(base_, stamp.sec(), stamp.nanosec(),
                     image.format() == "jpeg" ? ".jpg" : ".unknown", image.data().data(),
                     image.data().size());
    }
  }

 private:
  Received& received_;
  std::mutex& mutex_;
  const std::string base_;
};

template <class Entity>
Entity* require(Entity* entity) {
  if (entity != nullptr) return entity;
  std::fputs("Fast DDS refuses\n", stderr);
  std::exit(1);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  Received received(argv[1]);
  std::mutex mutex;
  auto* participant = require(fast::DomainParticipantFactory::get_instance()->create_participant(
      0, fast::PARTICIPANT_QOS_DEFAULT));
  auto* subscriber = require(participant->create_subscriber(fast::SUBSCRIBER_QOS_DEFAULT));
  const fast::TypeSupport type(new sensor_msgs::msg::dds_::CompressedImage_PubSubType);
  type.register_type(participant);
  fast::DataReaderQos qos;
  const bool is_reliable = std::string(argv[2]) == "reliable";
  qos.reliability().kind =
      is_reliable ? fast::RELIABLE_RELIABILITY_QOS : fast::BEST_EFFORT_RELIABILITY_QOS;
  qos.history().kind = fast::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = 2000;
  qos.resource_limits().max_samples = 0;  // no limits but the depth
  qos.resource_limits().max_samples_per_instance = 0;
  qos.endpoint().history_memory_policy =
      eprosima::fastrtps::rtps::PREALLOCATED_WITH_REALLOC_MEMORY_MODE;
  std::vector<std::unique_ptr<ImageListener>> listeners;
  for (int i = 3; i < argc; ++i) {
    const std::string base = argv[i];
    received.expect(base);
    auto* topic = require(participant->create_topic("rt/" + base + "/image_raw/compressed",
                                                    type.get_type_name(), fast::TOPIC_QOS_DEFAULT));
    listeners.push_back(std::make_unique<ImageListener>(received, mutex, base));
    require(subscriber->create_datareader(topic, qos, listeners.back().get()));
  }
  std::puts("ready");
  std::fflush(stdout);
  for (;;) ::pause();
}
