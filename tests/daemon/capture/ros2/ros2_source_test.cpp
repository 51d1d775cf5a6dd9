// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/ros2/ros2_source.hpp"

#include <gmock/gmock.h>

#include <functional>
#include <optional>
#include <thread>
#include <utility>

#include "testing/captured_log.hpp"
#include "testing/loopback_dds.hpp"
#include "tests/daemon/capture/source_test_support.hpp"
#include "tests/daemon/topics/topic_writer.hpp"

namespace orbbuf {
namespace {

using test::TopicWriter;
using test::write_jpeg;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

using Bytes = std::vector<std::uint8_t>;

const std::string kTopic = "/camera/image_raw";
const Bytes kJpeg{0xFF, 0xD8, 1, 2, 3, 0xFF, 0xD9};

class Ros2SourceTest : public testing::Test {
 protected:
  static void SetUpTestSuite() { test::use_loopback_dds("78"); }

  /// A publisher that writes as soon as the source reads it.
  void publish(const dds_topic_descriptor_t& type, std::function<void(const TopicWriter&)> write) {
    writer_.emplace(type, kTopic);
    writing_ = std::jthread([this, write = std::move(write)] {
      writer_->wait_for_reader();
      write(*writer_);
    });
  }
  void publish_jpegs(std::function<void(const TopicWriter&)> write) {
    publish(sensor_msgs_msg_dds__CompressedImage__desc, std::move(write));
  }
  void publish_pixels(std::uint32_t width, std::uint32_t height, std::uint32_t step,
                      std::string encoding, Bytes data) {
    publish(sensor_msgs_msg_dds__Image__desc, [=](const TopicWriter& writer) mutable {
      const auto size = static_cast<std::uint32_t>(data.size());
      const sensor_msgs_msg_dds__Image_ image{test::header(1, 5),
                                              height,
                                              width,
                                              encoding.data(),
                                              0,
                                              step,
                                              {size, size, data.data(), false}};
      writer.write(&image);
    });
  }
  static Bytes bytes(const std::optional<RawFrame>& frame) {
    return {frame->data.begin(), frame->data.end()};
  }

  Ros2Source source_{kTopic, false};
  std::optional<TopicWriter> writer_;
  std::jthread writing_;
};

TEST_F(Ros2SourceTest, AJpegIsPassedOnWithItsStamp) {
  publish_jpegs([](const TopicWriter& writer) {
    write_jpeg(writer, 1'700'000'000, kJpeg);
    write_jpeg(writer, 1'700'000'001, kJpeg, "jpeg");
  });
  const auto first = source_.next({});
  ASSERT_TRUE(first);
  EXPECT_EQ(first->capture_time_ns, 1'700'000'000'000'000'005);
  EXPECT_EQ(first->format, PixelFormat::kJpeg);
  EXPECT_EQ(first->defect, "");
  const auto second = source_.next({});
  ASSERT_TRUE(second);
  EXPECT_EQ(second->capture_time_ns, 1'700'000'001'000'000'005);
  EXPECT_EQ(bytes(first), kJpeg);
  EXPECT_EQ(bytes(second), kJpeg);
}

TEST_F(Ros2SourceTest, AnotherCompressionIsADefect) {
  publish_jpegs([](const TopicWriter& writer) {
    write_jpeg(writer, 1, {0x89, 'P', 'N', 'G'}, "rgb8; png compressed \n");
    write_jpeg(writer, 2, {});
  });
  const auto png = source_.next({});
  ASSERT_TRUE(png);
  EXPECT_EQ(
      png->defect,
      "topic /camera/image_raw: the compressed image is not a JPEG; its format is \"rgb8; png "
      "compressed ?\"");
  EXPECT_EQ(png->capture_time_ns, 1'000'000'005);
  EXPECT_TRUE(png->data.empty());
  EXPECT_THAT(source_.next({})->defect, HasSubstr("not a JPEG"));
}

TEST_F(Ros2SourceTest, GrayPixelsAreReadWithoutTheirPadding) {
  publish_pixels(2, 2, 3, "mono8", {1, 2, 0, 3, 4, 0});
  const auto frame = source_.next({});
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->format, PixelFormat::kGray8);
  EXPECT_EQ(frame->width_px, 2);
  EXPECT_EQ(frame->height_px, 2);
  EXPECT_EQ(frame->capture_time_ns, 1'000'000'005);
  EXPECT_THAT(bytes(frame), ElementsAre(1, 2, 3, 4));
}

TEST_F(Ros2SourceTest, RedAndBlueAreSwapped) {
  publish_pixels(1, 1, 3, "rgb8", {1, 2, 3});
  const auto frame = source_.next({});
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->format, PixelFormat::kBgr24);
  EXPECT_THAT(bytes(frame), ElementsAre(3, 2, 1));
}

TEST_F(Ros2SourceTest, PixelsThatAreNotReadAreADefect) {
  publish_pixels(1, 1, 2, "16UC1", {1, 2});
  EXPECT_THAT(source_.next({})->defect, HasSubstr("the encoding \"16UC1\""));
}

TEST_F(Ros2SourceTest, SizesThatCannotBeAreADefect) {
  publish(sensor_msgs_msg_dds__Image__desc, [](const TopicWriter& writer) {
    std::string encoding = "bgr8";
    sensor_msgs_msg_dds__Image_ image{};
    image.encoding = encoding.data();
    const auto write = [&](std::int32_t sec, std::uint32_t width, std::uint32_t height,
                           std::uint32_t step) {
      Bytes data(9);
      image.header = test::header(sec, 0);
      image.width = width;
      image.height = height;
      image.step = step;
      image.data = {9, 9, data.data(), false};
      writer.write(&image);
    };
    write(1, 0, 3, 3);
    write(2, 1, 0, 3);
    write(3, 2, 3, 3);
    write(4, 65536, 1, 65536 * 3);
    write(5, 0x5555'5556, 1, 2);  // three times the width is 2 in 32 bits
    write(6, 1, 4, 3);
  });
  for (int i = 0; i < 5; ++i) EXPECT_THAT(source_.next({})->defect, HasSubstr("cannot be")) << i;
  EXPECT_THAT(source_.next({})->defect, HasSubstr("truncated"));
}

TEST_F(Ros2SourceTest, AStampThatDoesNotFitIsReplacedAndLoggedOnce) {
  const test::CapturedLog log;
  publish_jpegs([](const TopicWriter& writer) {
    for (const int sec : {2, 2, 1, 0, 9, 3}) write_jpeg(writer, sec, kJpeg);
  });
  EXPECT_EQ(source_.next({})->capture_time_ns, 2'000'000'005);
  std::int64_t last_ns = 2'000'000'005;
  for (int i = 0; i < 5; ++i) {
    const std::int64_t time_ns = source_.next({})->capture_time_ns;
    EXPECT_GT(time_ns, std::exchange(last_ns, time_ns));
  }
  EXPECT_LT(last_ns, 9'000'000'005);
  EXPECT_THAT(log.lines("topic /camera/image_raw: the stamp"), SizeIs(1));
}

TEST_F(Ros2SourceTest, AStopEndsTheWait) {
  std::stop_source stop;
  const std::jthread stopping([&] { stop.request_stop(); });
  EXPECT_FALSE(source_.next(stop.get_token()));
}

}  // namespace
}  // namespace orbbuf
