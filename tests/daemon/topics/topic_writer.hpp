// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <dds/dds.h>
#include <gtest/gtest.h>
#include <ros_messages.h>

#include <optional>
#include <string>
#include <vector>

namespace orbbuf::test {

/// A publisher of ROS 2 in this process; made when there is a reader in the domain, and destroyed
/// before the last one.
class TopicWriter {
 public:
  enum Reliability { kReliable, kBestEffort };

  TopicWriter(const dds_topic_descriptor_t& type, const std::string& topic,
              Reliability reliability = kReliable)
      : participant_(dds_create_participant(78, nullptr, nullptr)) {
    const auto named =
        dds_create_topic(participant_, &type, ("rt" + topic).c_str(), nullptr, nullptr);
    dds_qos_t* qos = dds_create_qos();
    dds_qset_reliability(
        qos, reliability == kReliable ? DDS_RELIABILITY_RELIABLE : DDS_RELIABILITY_BEST_EFFORT,
        DDS_SECS(1));
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
    writer_ = dds_create_writer(participant_, named, qos, nullptr);
    dds_delete_qos(qos);
    EXPECT_GT(writer_, 0);
  }
  ~TopicWriter() { dds_delete(participant_); }
  TopicWriter(const TopicWriter&) = delete;
  TopicWriter& operator=(const TopicWriter&) = delete;

  void write(const void* message) const { EXPECT_EQ(dds_write(writer_, message), 0); }

  void wait_for_reader() const {
    dds_set_status_mask(writer_, DDS_PUBLICATION_MATCHED_STATUS);
    const auto waitset = dds_create_waitset(participant_);
    dds_waitset_attach(waitset, writer_, 0);
    dds_publication_matched_status_t matched{};
    while (dds_get_publication_matched_status(writer_, &matched) == 0 && matched.current_count == 0)
      dds_waitset_wait(waitset, nullptr, 0, DDS_SECS(1));
    dds_delete(waitset);
  }

  /// Of the reader; nothing: there is none.
  std::optional<Reliability> reader() const {
    dds_instance_handle_t handle = 0;
    if (dds_get_matched_subscriptions(writer_, &handle, 1) < 1) return std::nullopt;
    auto* const endpoint = dds_get_matched_subscription_data(writer_, handle);
    dds_reliability_kind_t kind{};
    dds_qget_reliability(endpoint->qos, &kind, nullptr);
    dds_builtintopic_free_endpoint(endpoint);
    return kind == DDS_RELIABILITY_RELIABLE ? kReliable : kBestEffort;
  }

 private:
  const dds_entity_t participant_;
  dds_entity_t writer_ = 0;
};

inline std_msgs_msg_dds__Header_ header(std::int32_t sec, std::uint32_t nanosec) {
  static std::string frame_id = "camera";
  return {{sec, nanosec}, frame_id.data()};
}

inline void write_jpeg(const TopicWriter& writer, std::int32_t sec, std::vector<std::uint8_t> data,
                       std::string format = "bgr8; jpeg compressed bgr8") {
  const auto size = static_cast<std::uint32_t>(data.size());
  const sensor_msgs_msg_dds__CompressedImage_ image{
      header(sec, 5), format.data(), {size, size, data.data(), false}};
  writer.write(&image);
}

}  // namespace orbbuf::test
