// SPDX-License-Identifier: Apache-2.0
#include "common/dds/dds_camera.hpp"

#include <dds/dds.h>
#include <dds/ddsi/ddsi_serdata.h>
#include <gtest/gtest.h>
#include <ros_messages.h>

#include <algorithm>
#include <string>
#include <vector>

#include "testing/loopback_dds.hpp"

namespace orbbuf {
namespace {

using Bytes = std::vector<std::uint8_t>;

constexpr std::int64_t kTimeNs = 1'000'000'002;  // 1 s and 2 ns

/// A camera and a reader of one of its topics, in this process.
class DdsCameraTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { test::use_loopback_dds("77"); }
  void SetUp() override {
    participant_.emplace();
    camera_.emplace(*participant_, "robot", "cam");
  }
  void TearDown() override {
    camera_.reset();
    participant_.reset();
  }

  dds_entity_t read(const dds_topic_descriptor_t& type, const std::string& topic,
                    dds_durability_kind durability = DDS_DURABILITY_VOLATILE) {
    const dds_entity_t named =
        dds_create_topic(participant_->entity(), &type, topic.c_str(), nullptr, nullptr);
    dds_qos_t* qos = dds_create_qos();
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    dds_qset_durability(qos, durability);
    dds_qset_history(qos, DDS_HISTORY_KEEP_ALL, 0);
    const dds_entity_t reader = dds_create_reader(participant_->entity(), named, qos, nullptr);
    dds_delete_qos(qos);
    EXPECT_GT(reader, 0);
    return reader;
  }

  /// The message on the wire; empty if there is none.
  static Bytes take(dds_entity_t reader) {
    ddsi_serdata* data = nullptr;
    dds_sample_info_t info;
    if (dds_takecdr(reader, &data, 1, &info, DDS_ANY_STATE) != 1) return {};
    Bytes bytes(ddsi_serdata_size(data));
    ddsi_serdata_to_ser(data, 0, bytes.size(), bytes.data());
    ddsi_serdata_unref(data);
    return bytes;
  }

  std::optional<DdsParticipant> participant_;
  std::optional<DdsCamera> camera_;
};

/// A message: CDR_LE, version 1, how many bytes of padding end it; the stamp, the frame id; `rest`.
Bytes with_header(std::uint8_t padding, const Bytes& rest) {
  Bytes bytes{0x00, 0x01, 0x00, padding,                          // encapsulation
              0x01, 0x00, 0x00, 0x00,    0x02, 0x00, 0x00, 0x00,  // 1 s, 2 ns
              0x04, 0x00, 0x00, 0x00,    'c',  'a',  'm',  0x00};
  bytes.insert(bytes.end(), rest.begin(), rest.end());
  return bytes;
}

TEST_F(DdsCameraTest, ACompressedImageHasTheBytesOfRos2) {
  const auto reader =
      read(sensor_msgs_msg_dds__CompressedImage__desc, "rt/robot/image_raw/compressed");
  const Bytes jpeg{0xFF, 0xD8, 0xD9};
  EXPECT_FALSE(camera_->publish(kTimeNs, jpeg, nullptr));
  EXPECT_EQ(take(reader), with_header(1, {0x05, 0x00, 0x00, 0x00, 'j',  'p',  'e',  'g',
                                          0x00, 0x00, 0x00, 0x00,  // padding
                                          0x03, 0x00, 0x00, 0x00, 0xFF, 0xD8, 0xD9, 0x00}));
}

TEST_F(DdsCameraTest, ARawImageHasTheBytesOfRos2) {
  EXPECT_FALSE(camera_->has_raw_reader());
  const auto reader = read(sensor_msgs_msg_dds__Image__desc, "rt/robot/image_raw");
  EXPECT_TRUE(camera_->has_raw_reader());
  EXPECT_FALSE(camera_->publish_raw(kTimeNs, GrayImage{2, 3, {1, 2, 3, 4, 5, 6}}));
  EXPECT_EQ(
      take(reader),
      with_header(2, {0x03, 0x00, 0x00, 0x00, 0x02, 0x00, 0x00, 0x00,  // height, width
                      0x06, 0x00, 0x00, 0x00, 'm',  'o',  'n',  'o',  '8', 0x00,
                      0x00,                    // is_bigendian
                      0x00,                    // padding
                      0x02, 0x00, 0x00, 0x00,  // step
                      0x06, 0x00, 0x00, 0x00, 1,    2,    3,    4,    5,   6,    0x00, 0x00}));
}

CameraInfo small_camera() {
  CameraInfo camera;
  camera.width_px = 2;
  camera.height_px = 3;
  camera.distortion_model = "abc";
  camera.distortion = {1};
  camera.k = {1, 1, 1, 1, 1, 1, 1, 1, 1};
  camera.p = {2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2};
  return camera;
}

/// A double, 1 or 2, little-endian; `count` of them. 0: eight zeros.
void append(Bytes& bytes, int value, int count) {
  for (int i = 0; i < count; ++i) {
    bytes.insert(bytes.end(), 6, 0x00);
    const Bytes top = value == 0 ? Bytes{0, 0} : value == 1 ? Bytes{0xF0, 0x3F} : Bytes{0x00, 0x40};
    bytes.insert(bytes.end(), top.begin(), top.end());
  }
}

TEST_F(DdsCameraTest, ASampleHasTheBytesOfRos2) {
  DdsImu imu(*participant_, "robot/imu0", "cam");
  const auto reader = read(sensor_msgs_msg_dds__Imu__desc, "rt/robot/imu0");
  EXPECT_FALSE(imu.publish({kTimeNs, {1, 2, 0}, {0, 1, 2}}));
  Bytes rest;
  append(rest, 0, 3);  // orientation
  append(rest, 1, 1);
  rest.insert(rest.end(), {0, 0, 0, 0, 0, 0, 0xF0, 0xBF});  // -1: there is none
  append(rest, 0, 8);
  for (const int value : {1, 2, 0}) append(rest, value, 1);
  append(rest, 0, 9);
  for (const int value : {0, 1, 2}) append(rest, value, 1);
  append(rest, 0, 9);
  Bytes expected = with_header(0, {});
  expected.insert(expected.end(), rest.begin(), rest.end());
  EXPECT_EQ(take(reader), expected);
}

TEST_F(DdsCameraTest, AMessageOfATopicIsAsItsPublishersWere) {
  DdsTopics topics(*participant_, "robot");
  const auto publish = [&](std::uint64_t key, std::uint8_t byte) {
    const TopicPublisher publisher{key,  "/imu", "sensor_msgs::msg::dds_::Imu_", "typehash=x;", 1,
                                   true, true};
    const TopicMessage message{std::make_shared<const TopicPublisher>(publisher), kTimeNs,
                               Bytes{0, 1, 0, 0, byte, 2, 3, 4}};
    const auto begin = topics.begin_of(message);
    EXPECT_FALSE(topics.publish(message));
    return begin;
  };
  const auto now = DdsTopics::Clock::now();
  const auto begin = publish(1, 1);
  EXPECT_GE(begin, now + DdsTopics::kDiscovery);
  EXPECT_EQ(publish(1, 2), begin);  // replaces the first
  EXPECT_GT(publish(2, 3), begin);  // another publisher's
  const RawTopic topic(participant_->entity(), "rt/robot/imu", "sensor_msgs::msg::dds_::Imu_");
  dds_qos_t* const qos = dds_create_qos();
  dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
  dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
  dds_qset_history(qos, DDS_HISTORY_KEEP_ALL, 0);
  const dds_entity_t reader =
      dds_create_reader(participant_->entity(), topic.entity(), qos, nullptr);
  dds_delete_qos(qos);
  std::vector<int> bytes;
  while (const auto message = take_raw(reader)) {
    EXPECT_EQ(message->time_ns, kTimeNs);
    bytes.push_back(message->cdr.at(4));
  }
  std::ranges::sort(bytes);
  EXPECT_EQ(bytes, (std::vector<int>{2, 3}));
  dds_instance_handle_t writer = 0;
  ASSERT_EQ(dds_get_matched_publications(reader, &writer, 1), 2);
  auto* const endpoint = dds_get_matched_publication_data(reader, writer);
  void* data = nullptr;
  std::size_t size = 0;
  EXPECT_TRUE(dds_qget_userdata(endpoint->qos, &data, &size));
  EXPECT_EQ(std::string(static_cast<char*>(data), size), "typehash=x;");
  dds_free(data);
  dds_builtintopic_free_endpoint(endpoint);
}

TEST_F(DdsCameraTest, ACameraInfoHasTheBytesOfRos2) {
  const auto reader = read(sensor_msgs_msg_dds__CameraInfo__desc, "rt/robot/camera_info");
  const CameraInfo camera = small_camera();
  EXPECT_FALSE(camera_->publish(kTimeNs, Bytes{1}, &camera));
  Bytes expected = with_header(3, {0x03, 0x00, 0x00, 0x00, 0x02, 0x00, 0x00, 0x00,  // height, width
                                   0x04, 0x00, 0x00, 0x00, 'a',  'b',  'c',  0x00,
                                   0x01, 0x00, 0x00, 0x00,    // one number of d
                                   0x00, 0x00, 0x00, 0x00});  // padding: doubles are aligned to 8
  append(expected, 1, 1 + 9);
  for (int row = 0; row < 3; ++row) {
    append(expected, 0, row);
    append(expected, 1, 1);
    append(expected, 0, 2 - row);
  }
  append(expected, 2, 12);
  expected.insert(expected.end(), 2 * 4 + 4 * 4 + 1, 0x00);  // binning, region of interest
  expected.insert(expected.end(), 3, 0x00);                  // a message is whole words
  EXPECT_EQ(take(reader), expected);
}

TEST_F(DdsCameraTest, OnlyTheLastCameraInfoWaitsForALateReader) {
  const CameraInfo camera = small_camera();
  EXPECT_FALSE(camera_->publish(kTimeNs, Bytes{1}, &camera));
  EXPECT_FALSE(camera_->publish(2 * kTimeNs, Bytes{2}, &camera));
  const auto infos = read(sensor_msgs_msg_dds__CameraInfo__desc, "rt/robot/camera_info",
                          DDS_DURABILITY_TRANSIENT_LOCAL);
  const Bytes info = take(infos);
  ASSERT_GT(info.size(), 4U);
  EXPECT_EQ(info[4], 2);  // the second's stamp
  EXPECT_TRUE(take(infos).empty());
  const auto images =
      read(sensor_msgs_msg_dds__CompressedImage__desc, "rt/robot/image_raw/compressed");
  EXPECT_TRUE(take(images).empty());
}

}  // namespace
}  // namespace orbbuf
