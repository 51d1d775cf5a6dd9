// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/video_replay_source.hpp"

#include <fmt/core.h>
#include <gmock/gmock.h>

#include <string_view>

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
  /// Frame i is of one colour: blue 10 * i, green 100, red 200. Motion JPEG needs no other library.
  void write_video(int count) {
    const auto fourcc = cv::VideoWriter::fourcc('M', 'J', 'P', 'G');
    cv::VideoWriter video((folder_ / "v.avi").string(), cv::CAP_OPENCV_MJPEG, fourcc, 20.0,
                          {64, 48});
    ASSERT_TRUE(video.isOpened());
    for (int i = 0; i < count; ++i) {
      video.write(cv::Mat(48, 64, CV_8UC3, cv::Scalar(10 * i, 100, 200)));
    }
  }
  /// Overwrites these frames of a Motion JPEG.
  static void blank(const std::filesystem::path& file, const std::vector<std::size_t>& frames) {
    constexpr std::string_view kBegin("\xFF\xD8\xFF"), kEnd("\xFF\xD9");
    std::string bytes = test::read_file(file);
    std::vector<std::size_t> begins;
    for (auto at = bytes.find(kBegin); at != bytes.npos; at = bytes.find(kBegin, at + 1)) {
      begins.push_back(at);
    }
    for (const auto frame : frames) {
      const auto begin = begins.at(frame);
      const auto length = bytes.find(kEnd, begin) + kEnd.size() - begin;
      bytes.replace(begin, length, length, '\0');
    }
    write_file(file, bytes);
  }
  /// In the two headers of an AVI.
  static void state_height(const std::filesystem::path& file, int height_px) {
    std::string bytes = test::read_file(file);
    for (const auto at : {bytes.find("avih") + 44, bytes.find("strf") + 16}) {
      bytes.at(at) = static_cast<char>(height_px);
    }
    write_file(file, bytes);
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
    EXPECT_NEAR(frame->data[0], 0.114 * 10 * i + 0.587 * 100 + 0.299 * 200, 4);
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
    EXPECT_NEAR(frame.data[0], 10 * i, 6);
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

TEST_F(VideoReplaySourceTest, AVideoThatBreaksOffIsAnError) {
  write_video(20);
  const auto size = std::filesystem::file_size(folder_ / "v.avi");
  std::filesystem::resize_file(folder_ / "v.avi", size / 2);
  VideoReplaySource source(settings("v.avi"));
  std::vector<RawFrame> frames;
  const auto text = error_of([&] {
    while (auto frame = source.next({})) frames.push_back(std::move(*frame));
  });
  EXPECT_THAT(text, HasSubstr("breaks off at 0."));
  EXPECT_THAT(text, HasSubstr(fmt::format("of the 1.00 s that it states: {} frames were read",
                                          frames.size() - 1)));
  ASSERT_GE(frames.size(), 2U);
  EXPECT_LT(frames.size(), 15U);
  EXPECT_THAT(frames.back().defect, HasSubstr("cannot read the frame at 0."));
}

TEST_F(VideoReplaySourceTest, FramesThatCannotBeDecodedComeWithADefect) {
  write_video(20);
  blank(folder_ / "v.avi", {0, 3, 12, 13, 19});
  VideoReplaySource source(settings("v.avi"));
  std::vector<int> bad;
  for (int i = 0; i < 20; ++i) {
    const auto frame = source.next({});
    ASSERT_TRUE(frame) << i;
    EXPECT_EQ(frame->capture_time_ns, i * 50'000'000);
    if (!frame->defect.empty()) bad.push_back(i);
    if (frame->defect.empty()) {
      EXPECT_NEAR(frame->data[0], 0.114 * 10 * i + 0.587 * 100 + 0.299 * 200, 4) << i;
    }
  }
  EXPECT_FALSE(source.next({}));
  EXPECT_EQ(bad, (std::vector<int>{0, 3, 12, 13, 19}));
}

/// FFmpeg takes them for the halves of frames: each other one failed, and the rest showed two at
/// once.
TEST_F(VideoReplaySourceTest, ImagesThatAreNotAsHighAsTheFileStatesAllCome) {
  for (const int height_px : {96, 40, 65}) {
    write_video(12);
    state_height(folder_ / "v.avi", height_px);
    VideoReplaySource source(settings("v.avi"));
    for (int i = 0; i < 12; ++i) {
      const auto frame = source.next({});
      ASSERT_TRUE(frame);
      EXPECT_EQ(frame->capture_time_ns, i * 50'000'000);
      ASSERT_EQ(frame->defect, "") << i;
      EXPECT_EQ(frame->height_px, 48);
      EXPECT_NEAR(frame->data[0], 0.114 * 10 * i + 0.587 * 100 + 0.299 * 200, 4);
    }
    EXPECT_FALSE(source.next({}));
  }
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
