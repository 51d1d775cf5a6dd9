// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/video_replay_source.hpp"

#include <gmock/gmock.h>

#include "testing/temporary_folder.hpp"
#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using test::error_of;
using test::TemporaryFolder;
using test::write_file;
using testing::EndsWith;
using testing::HasSubstr;

class VideoReplaySourceTest : public testing::Test {
 protected:
  /// Frame i is of one colour: blue 20 * i, green 100, red 200. Motion JPEG needs no other library.
  void write_video(int count) {
    const auto fourcc = cv::VideoWriter::fourcc('M', 'J', 'P', 'G');
    cv::VideoWriter video((folder_ / "v.avi").string(), cv::CAP_OPENCV_MJPEG, fourcc, 20.0,
                          {64, 48});
    ASSERT_TRUE(video.isOpened());
    for (int i = 0; i < count; ++i) {
      video.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar(20 * i, 100, 200)));
    }
  }
  SourceSettings settings(const std::string& name, bool color = false) {
    SourceSettings settings;
    settings.path = folder_ / name;
    settings.color = color;
    return settings;
  }
  std::string error(const SourceSettings& settings) {
    return error_of([&] { VideoReplaySource source(settings); });
  }

  TemporaryFolder folder_;
};

TEST_F(VideoReplaySourceTest, EveryFrameComesOnceAtTheRateOfTheFile) {
  write_video(5);
  VideoReplaySource source(settings("v.avi"));
  for (int i = 0; i < 5; ++i) {
    const auto frame = source.next({});
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->capture_time_ns, i * 50'000'000);
    EXPECT_EQ(frame->format, PixelFormat::kGray8);
    EXPECT_EQ(frame->width_px, 64);
    EXPECT_EQ(frame->height_px, 48);
    EXPECT_NEAR(frame->data[0], 0.114 * 20 * i + 0.587 * 100 + 0.299 * 200, 4);
  }
  EXPECT_FALSE(source.next({}));
  EXPECT_FALSE(source.next({}));
}

TEST_F(VideoReplaySourceTest, ColourIsKeptWhereAskedForAndFramesOutliveTheSource) {
  write_video(3);
  std::vector<RawFrame> frames;
  {
    VideoReplaySource source(settings("v.avi", true));
    while (auto frame = source.next({})) frames.push_back(std::move(*frame));
  }
  ASSERT_EQ(frames.size(), 3U);
  for (int i = 0; i < 3; ++i) {
    const auto& frame = frames[static_cast<std::size_t>(i)];
    ASSERT_EQ(frame.format, PixelFormat::kBgr24);
    EXPECT_NEAR(frame.data[0], 20 * i, 6);
    EXPECT_NEAR(frame.data[1], 100, 6);
    EXPECT_NEAR(frame.data[2], 200, 6);
  }
}

TEST_F(VideoReplaySourceTest, WhatIsNoVideoStopsTheStartWithTheReason) {
  write_file(folder_ / "text.avi", "no video at all");
  write_file(folder_ / "empty.avi", "");
  EXPECT_THAT(error(settings("text.avi")),
              HasSubstr("text.avi: neither FFmpeg nor OpenCV recognises"));
  EXPECT_THAT(error(settings("empty.avi")),
              HasSubstr("empty.avi: neither FFmpeg nor OpenCV recognises"));
  EXPECT_THAT(error(settings("none.avi")), EndsWith("none.avi: No such file or directory"));
  EXPECT_THAT(error(settings(".")), EndsWith("not a regular file"));
  EXPECT_THAT(error({}), HasSubstr("source.path is not set"));
}

TEST_F(VideoReplaySourceTest, AVideoThatBreaksOffEndsThere) {
  write_video(5);
  const auto size = std::filesystem::file_size(folder_ / "v.avi");
  std::filesystem::resize_file(folder_ / "v.avi", size * 7 / 10);
  VideoReplaySource source(settings("v.avi"));
  int count = 0;
  while (source.next({})) ++count;
  EXPECT_GE(count, 1);
  EXPECT_LT(count, 5);
}

TEST_F(VideoReplaySourceTest, AStopEndsIt) {
  write_video(2);
  VideoReplaySource source(settings("v.avi"));
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(source.next(stop.get_token()));
}

}  // namespace
}  // namespace orbbuf
