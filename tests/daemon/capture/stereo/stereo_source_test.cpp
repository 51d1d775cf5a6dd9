// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/stereo/stereo_source.hpp"

#include <gmock/gmock.h>

#include <cstdint>
#include <memory>
#include <thread>
#include <utility>

#include "testing/scripted_source.hpp"
#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using std::chrono::milliseconds;
using test::ScriptedSource;
using testing::HasSubstr;

RawFrame frame_at(std::int64_t time_ms) {
  RawFrame frame;
  frame.monotonic_ns = time_ms * 1'000'000;
  frame.capture_time_ns = frame.monotonic_ns + 5;
  return frame;
}

class StereoSourceTest : public testing::Test {
 protected:
  std::unique_ptr<ScriptedSource> left_camera_ = std::make_unique<ScriptedSource>(true, "camera a");
  std::unique_ptr<ScriptedSource> right_camera_ =
      std::make_unique<ScriptedSource>(true, "camera b");
  ScriptedSource& left_ = *left_camera_;
  ScriptedSource& right_ = *right_camera_;
  StereoSource source_{std::move(left_camera_), std::move(right_camera_), milliseconds(20)};
};

TEST_F(StereoSourceTest, APairIsOneFrameUnderTheLeftImagesTime) {
  EXPECT_TRUE(source_.is_live());
  EXPECT_EQ(source_.description(), "stereo: left camera a; right camera b; up to 20 ms apart");
  for (std::int64_t i = 0; i < 100; ++i) {
    right_.add(frame_at(40 * i + 3));
    left_.add(frame_at(40 * i));
    const auto frame = source_.next({});
    ASSERT_TRUE(frame && frame->right);
    EXPECT_EQ(frame->capture_time_ns, 40'000'000 * i + 5);
    EXPECT_EQ(frame->right->capture_time_ns, 40'000'000 * i + 3'000'005);
  }
}

TEST_F(StereoSourceTest, OneWithoutTheOtherIsNoFrame) {
  left_.add(frame_at(0));
  left_.add(frame_at(40));
  right_.add(frame_at(38));
  EXPECT_EQ(source_.next({})->capture_time_ns, 40'000'005);
}

TEST_F(StereoSourceTest, ItEndsWhenBothHaveAfterTheirLastFrames) {
  left_.add(frame_at(0));
  left_.end();
  right_.add(frame_at(0));
  right_.end();
  EXPECT_TRUE(source_.next({}));
  EXPECT_FALSE(source_.next({}));
}

TEST_F(StereoSourceTest, ACameraThatIsGoneForGoodIsTheSourcesFailure) {
  right_.end("camera b burnt");
  EXPECT_THAT(test::error_of([&] { source_.next({}); }), HasSubstr("camera b burnt"));
}

TEST_F(StereoSourceTest, AStopEndsItThoughNothingComes) {
  std::stop_source stop;
  std::jthread stopper([&] { stop.request_stop(); });
  EXPECT_FALSE(source_.next(stop.get_token()));
}

}  // namespace
}  // namespace orbbuf
