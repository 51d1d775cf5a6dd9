// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pace.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

using std::chrono::milliseconds;

EncodedFrame frame_at(Sequence sequence, milliseconds capture_time) {
  EncodedFrame frame;
  frame.sequence = sequence;
  frame.capture_time_ns = std::chrono::nanoseconds(capture_time).count();
  return frame;
}

class PaceTest : public testing::Test {
 protected:
  PaceTest() { pace_.published(frame_at(10, milliseconds{1000}), now_); }
  /// From the last frame to this one.
  Pace::Clock::duration spacing(Sequence sequence, milliseconds capture_time) const {
    return pace_.due(frame_at(sequence, capture_time)) - now_;
  }

  const Pace::Clock::time_point now_{std::chrono::hours{1}};
  Pace pace_{2.0};
};

TEST_F(PaceTest, TheFirstFrameIsDueAtOnce) {
  EXPECT_LT(Pace(2.0).due(frame_at(0, milliseconds{0})), now_);
}

TEST_F(PaceTest, TheNextFrameFollowsAfterThePeriodDividedByTheSpeed) {
  EXPECT_EQ(spacing(11, milliseconds{1040}), milliseconds{20});
}

TEST_F(PaceTest, DroppedFramesDoNotChangeThePeriod) {
  EXPECT_EQ(spacing(15, milliseconds{1200}), milliseconds{20});
}

TEST_F(PaceTest, AClockThatWasSetDelaysNoFrameForLong) {
  EXPECT_EQ(spacing(11, milliseconds{3'600'000}), Pace::kLongest);
  EXPECT_EQ(spacing(11, milliseconds{1}), milliseconds{0});
}

TEST_F(PaceTest, ARepeatedFrameIsDueAtOnce) {
  EXPECT_LT(pace_.due(frame_at(10, milliseconds{1000})), now_);
}

}  // namespace
}  // namespace orbbuf
