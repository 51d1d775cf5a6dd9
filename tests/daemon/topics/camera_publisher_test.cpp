// SPDX-License-Identifier: Apache-2.0
#include "daemon/topics/camera_publisher.hpp"

#include <dds/dds.h>
#include <gtest/gtest.h>

#include <tuple>

#include "daemon/topics/header_time.hpp"
#include "daemon/topics/topic_reader.hpp"
#include "testing/loopback_dds.hpp"

namespace orbbuf {
namespace {

constexpr const char* kCalibration =
    "RadTan 100 101 80 60 -0.1 0.01 0.001 -0.001\n160 120\nnone\n160 120\n0.1\n";

/// Images of two bytes: `value`, and of a pair the right one's, 100 more.
FramePtr frame_of(std::uint8_t value, bool is_stereo) {
  EncodedFrame frame;
  frame.sequence = value;
  frame.capture_time_ns = value * 1'000'000'000LL;
  frame.jpeg = {value, value};
  frame.left_bytes = 2;
  if (is_stereo) frame.jpeg.insert(frame.jpeg.end(), 2, static_cast<std::uint8_t>(value + 100));
  return std::make_shared<const EncodedFrame>(std::move(frame));
}

/// A node on the robot: its own participant, a reliable reader of one topic.
class Node {
 public:
  Node(const dds_topic_descriptor_t& type, const char* topic)
      : participant_(dds_create_participant(78, nullptr, nullptr)) {
    dds_qos_t* const qos = dds_create_qos();
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, DDS_SECS(1));
    dds_qset_history(qos, DDS_HISTORY_KEEP_LAST, 10);
    reader_ = dds_create_reader(
        participant_, dds_create_topic(participant_, &type, topic, nullptr, nullptr), qos, nullptr);
    dds_delete_qos(qos);
    EXPECT_GT(reader_, 0);
    dds_set_status_mask(reader_, DDS_DATA_AVAILABLE_STATUS);
    waitset_ = dds_create_waitset(participant_);
    dds_waitset_attach(waitset_, reader_, 0);
  }
  ~Node() { dds_delete(participant_); }
  Node(const Node&) = delete;
  Node& operator=(const Node&) = delete;

  /// Waits for a message.
  template <class Message, class Look>
  auto take(Look look) const {
    void* samples[1] = {nullptr};
    dds_sample_info_t info;
    while (dds_take(reader_, samples, &info, 1, 1) < 1 || !info.valid_data) {
      dds_waitset_wait(waitset_, nullptr, 0, DDS_SECS(1));
    }
    const auto seen = look(*static_cast<const Message*>(samples[0]));
    dds_return_loan(reader_, samples, 1);
    return seen;
  }
  /// Of a compressed image: its stamp, its frame id and its bytes.
  auto take_image() const {
    return take<sensor_msgs_msg_dds__CompressedImage_>([](const auto& image) {
      return std::tuple(time_ns_of(image.header), std::string(image.header.frame_id),
                        std::vector(image.data._buffer, image.data._buffer + image.data._length));
    });
  }

 private:
  dds_entity_t participant_;
  dds_entity_t reader_ = 0;
  dds_entity_t waitset_ = 0;
};

class CameraPublisherTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { test::use_loopback_dds("78"); }
};

TEST_F(CameraPublisherTest, ANodeGetsEachFrameWithItsStampAndItsCalibration) {
  CameraPublisher publisher("/front/camera", kCalibration);
  const Node node(sensor_msgs_msg_dds__CompressedImage__desc,
                  "rt/front/camera/right/image_raw/compressed");
  const Node info(sensor_msgs_msg_dds__CameraInfo__desc, "rt/front/camera/right/camera_info");
  for (std::uint8_t value = 1; value < 4; ++value) {
    publisher.publish(frame_of(value, true));
    const auto right = static_cast<std::uint8_t>(value + 100);
    EXPECT_EQ(node.take_image(), std::tuple(value * 1'000'000'000LL, "front/camera",
                                            std::vector<std::uint8_t>{right, right}));
    const auto width_and_baseline = [](const auto& each) {
      return std::pair(each.width, each.p[3]);
    };
    EXPECT_EQ(info.take<sensor_msgs_msg_dds__CameraInfo_>(width_and_baseline),
              std::pair(160U, -10.0));
  }
}

TEST_F(CameraPublisherTest, OneImageIsWithoutSides) {
  CameraPublisher publisher("/camera", "");
  const Node node(sensor_msgs_msg_dds__CompressedImage__desc, "rt/camera/image_raw/compressed");
  publisher.publish(frame_of(7, false));
  EXPECT_EQ(std::get<2>(node.take_image()), (std::vector<std::uint8_t>{7, 7}));
}

TEST_F(CameraPublisherTest, ThisProcessDoesNotReadItsOwnTopics) {
  CameraPublisher publisher("/camera", "");
  TopicReader reader("/camera/*", {}, 10);
  const Node node(sensor_msgs_msg_dds__CompressedImage__desc, "rt/camera/image_raw/compressed");
  publisher.publish(frame_of(1, false));
  node.take_image();
  EXPECT_FALSE(reader.take());
  publisher.publish(frame_of(2, false));
  node.take_image();
  EXPECT_FALSE(reader.take());
}

}  // namespace
}  // namespace orbbuf
