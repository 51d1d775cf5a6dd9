// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/make_source.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <set>
#include <string>
#include <string_view>

#include "testing/temporary_folder.hpp"
#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using test::error_of;
using test::TemporaryFolder;
using testing::HasSubstr;

SourceSettings generated(std::int64_t frames) {
  SourceSettings settings;
  settings.width_px = 64;
  settings.height_px = 64;
  settings.frames = frames;
  settings.realtime = false;
  return settings;
}

std::string error(const SourceSettings& settings) {
  return error_of([&] { make_source(settings); });
}

bool is_built(std::string_view kind) {
  std::set<std::string_view> kinds{"generated", "folder"};
#ifdef ORBBUF_IMAGE_FILES
  kinds.insert("video");
#endif
#ifdef ORBBUF_V4L2
  kinds.insert("v4l2");
#endif
#ifdef ORBBUF_LIBCAMERA
  kinds.insert("libcamera");
#endif
#ifdef ORBBUF_DAEMON_DDS
  kinds.insert("ros2");
#endif
  return kinds.contains(kind);
}

/// Of a source whose folder, file or camera "absent" does not exist.
std::string expected_error(std::string_view kind) {
  if (!is_built(kind)) return "orbbufd was built without";
  return kind == "generated" ? "0x" : "absent";
}

TEST(MakeSource, TheDefaultIsALiveGeneratedScene) {
  const auto source = make_source({});
  EXPECT_TRUE(source->is_live());
  EXPECT_EQ(source->description(),
            "generated scene 1: 500 frames of 640x480 px, 25 fps, in real time");
}

TEST(MakeSource, AnUnknownKindIsRefusedWithAListOfThose) {
  SourceSettings settings;
  settings.kind = "webcam";
  EXPECT_THAT(error(settings),
              HasSubstr("'webcam': the kinds are generated, folder, video, v4l2, libcamera, ros2"));
}

TEST(MakeSource, EveryKindIsOpenedAtOnce) {
  const TemporaryFolder folder;
  for (const auto kind : kSourceKinds) {
    if (kind == "ros2" && is_built(kind)) continue;  // it waits for its topic
    SourceSettings settings;
    settings.kind = kind;
    settings.path = folder / "absent";
    settings.device = folder / "absent";
    settings.camera = "absent";
    settings.width_px = 0;
    EXPECT_THAT(error(settings), HasSubstr(expected_error(kind))) << kind;
  }
}

TEST(MakeSource, ARateThatIsNoneIsRefused) {
  for (const double fps : {0.0, -1.0, 1e-9, 1e9, HUGE_VAL, std::nan("")}) {
    SourceSettings settings;
    settings.fps = fps;
    EXPECT_THAT(error(settings), HasSubstr("fps")) << fps;
  }
}

TEST(MakeSource, ALoopBeginsAgainWithTimesGoingOn) {
  auto settings = generated(2);
  settings.fps = 10;
  settings.loop = true;
  const auto source = make_source(settings);
  EXPECT_FALSE(source->is_live());
  std::vector<RawFrame> frames;
  for (int i = 0; i < 5; ++i) {
    auto frame = source->next({});
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->capture_time_ns, i * 100'000'000);
    frames.push_back(std::move(*frame));
  }
  EXPECT_TRUE(std::equal(frames[1].data.begin(), frames[1].data.end(), frames[3].data.begin()));
}

/// As a camera's: ROS and Foxglove show them.
TEST(MakeSource, InRealTimeAGeneratedSceneHasTheTimeOfDayAndTheSameFrames) {
  auto settings = generated(1);
  const auto still = make_source(settings)->next({});
  settings.realtime = true;
  const auto before = std::chrono::system_clock::now();
  const auto live = make_source(settings)->next({});
  ASSERT_TRUE(still && live);
  EXPECT_EQ(still->capture_time_ns, 0);
  const std::chrono::system_clock::time_point captured{
      std::chrono::nanoseconds(live->capture_time_ns)};
  EXPECT_GE(captured, before);
  EXPECT_LE(captured, std::chrono::system_clock::now());
  EXPECT_TRUE(std::ranges::equal(still->data, live->data));
}

TEST(MakeSource, WithoutALoopItEnds) {
  const auto source = make_source(generated(1));
  EXPECT_TRUE(source->next({}));
  EXPECT_FALSE(source->next({}));
}

}  // namespace
}  // namespace orbbuf
