// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pace.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

using std::chrono::milliseconds;

constexpr std::int64_t ns(milliseconds time) { return std::chrono::nanoseconds(time).count(); }

class PaceTest : public testing::Test {
 protected:
  PaceTest() { pace_.published(10, ns(milliseconds{1000}), now_); }
  /// From the last frame to this one.
  Pace::Clock::duration spacing(Sequence sequence, milliseconds capture_time) const {
    return pace_.due(sequence, ns(capture_time)) - now_;
  }

  const Pace::Clock::time_point now_{std::chrono::hours{1}};
  Pace pace_{2.0};
};

TEST_F(PaceTest, TheFirstFrameIsDueAtOnce) { EXPECT_LT(Pace(2.0).due(0, 0), now_); }

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
  EXPECT_LT(pace_.due(10, ns(milliseconds{1000})), now_);
}

TEST_F(PaceTest, MessagesMayHaveAShorterLongest) {
  Pace pace(2.0, milliseconds{5});
  pace.published(0, 0, now_);
  EXPECT_EQ(pace.due(1, ns(milliseconds{40})) - now_, milliseconds{5});
}

TEST_F(PaceTest, OneThatCameLateDelaysNoOtherAndABurstIsSpreadAfterTheFirst) {
  Pace pace(2.0, Pace::kLongest, milliseconds{50});
  auto now = now_;
  pace.published(0, 0, now);
  now += milliseconds{70};  // late by 30 ms; the next one on time
  pace.published(1, ns(milliseconds{40}), now);
  EXPECT_LE(pace.due(2, ns(milliseconds{80})), now + milliseconds{10});
  pace.published(2, ns(milliseconds{80}), now);  // and two more at once
  EXPECT_LE(pace.due(3, ns(milliseconds{120})), now);
  pace.published(3, ns(milliseconds{120}), now);
  EXPECT_EQ(pace.due(4, ns(milliseconds{160})) - now, milliseconds{10});
  pace.published(4, ns(milliseconds{160}), now + milliseconds{10});
  EXPECT_EQ(pace.due(5, ns(milliseconds{200})) - now, milliseconds{30});
}

}  // namespace
}  // namespace orbbuf
