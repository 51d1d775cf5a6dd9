// SPDX-License-Identifier: Apache-2.0
#include "common/dds/dds_node.hpp"

#include <dds/dds.h>

#include <algorithm>
#include <array>
#include <memory>
#include <span>
#include <string_view>
#include <utility>

#include "common/cdr.hpp"
#include "common/dds/type_hash.hpp"
#include "common/system_clock.hpp"

namespace orbbuf {
namespace {

constexpr const char* kType = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_";
constexpr std::size_t kIdBytes = 16;
constexpr std::size_t kIdBytesOfHumble = 24;

/// An ID, with zeros behind it.
void put_id(Cdr& out, const dds_guid_t& guid, std::size_t id_bytes) {
  std::vector<std::uint8_t> id(std::begin(guid.v), std::end(guid.v));
  id.resize(id_bytes);
  out.put_array(id);
}

}  // namespace

DdsNode::DdsNode(const DdsParticipant& participant, std::string name, std::function<void()> look)
    : participant_(participant),
      name_(std::move(name)),
      look_(std::move(look)),
      topic_(participant.entity(), "ros_discovery_info", kType) {
  const std::unique_ptr<dds_qos_t, decltype(&dds_delete_qos)> qos(dds_create_qos(),
                                                                  &dds_delete_qos);
  const dds_data_representation_id_t xcdr1 = DDS_DATA_REPRESENTATION_XCDR1;
  dds_qset_data_representation(qos.get(), 1, &xcdr1);
  dds_qset_reliability(qos.get(), DDS_RELIABILITY_RELIABLE, DDS_MSECS(100));
  dds_qset_durability(qos.get(), DDS_DURABILITY_TRANSIENT_LOCAL);
  dds_qset_history(qos.get(), DDS_HISTORY_KEEP_LAST, 1);
  dds_qset_durability_service(qos.get(), 0, DDS_HISTORY_KEEP_LAST, 1, DDS_LENGTH_UNLIMITED,
                              DDS_LENGTH_UNLIMITED, DDS_LENGTH_UNLIMITED);
  set_type_hash(qos.get(), kType);
  const std::unique_ptr<dds_listener_t, decltype(&dds_delete_listener)> listener(
      dds_create_listener(const_cast<std::function<void()>*>(&look_)), &dds_delete_listener);
  dds_lset_publication_matched(listener.get(),
                               [](dds_entity_t, dds_publication_matched_status_t, void* call) {
                                 (*static_cast<const std::function<void()>*>(call))();
                               });
  writer_ = require_dds(
      dds_create_writer(participant.entity(), topic_.entity(), qos.get(), listener.get()),
      "write to the topic ros_discovery_info");
}

DdsNode::~DdsNode() { dds_delete(writer_); }

std::optional<Error> DdsNode::tell() {
  std::array<dds_instance_handle_t, 64> readers{};
  const auto count = dds_get_matched_subscriptions(writer_, readers.data(), readers.size());
  if (count <= 0) return std::nullopt;
  std::size_t id_bytes = kIdBytesOfHumble;
  const auto known = std::min(static_cast<std::size_t>(count), readers.size());
  for (const auto reader : std::span(readers).first(known)) {
    auto* const endpoint = dds_get_matched_subscription_data(writer_, reader);
    if (endpoint == nullptr) continue;  // it has left
    if (has_type_hash(endpoint->qos)) id_bytes = kIdBytes;
    dds_builtintopic_free_endpoint(endpoint);
  }
  auto now = message(id_bytes);
  if (now == told_) return std::nullopt;
  const int status = topic_.write(writer_, now, system_time_ns());
  if (status != DDS_RETCODE_OK) return Error{dds_strretcode(-status)};
  told_ = std::move(now);
  return std::nullopt;
}

std::vector<std::uint8_t> DdsNode::message(std::size_t id_bytes) const {
  std::vector<dds_guid_t> writers;
  dds_guid_t guid{};
  for (const dds_entity_t writer : writers_of(participant_.entity())) {
    // One that its session has just deleted has none.
    if (writer != writer_ && dds_get_guid(writer, &guid) == DDS_RETCODE_OK) writers.push_back(guid);
  }
  dds_get_guid(participant_.entity(), &guid);
  Cdr cdr;
  put_id(cdr, guid, id_bytes);
  cdr.put(std::uint32_t{1});  // node
  cdr.put(std::string_view("/"));
  cdr.put(std::string_view(name_));
  cdr.put(std::uint32_t{0});  // readers
  cdr.put(static_cast<std::uint32_t>(writers.size()));
  for (const dds_guid_t& writer : writers) put_id(cdr, writer, id_bytes);
  return cdr.take();
}

}  // namespace orbbuf
