// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/stamp_clock.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <vector>

#include "testing/captured_log.hpp"

namespace orbbuf {
namespace {

using testing::SizeIs;

/// A source at 20 items a second, whose arrivals are by another clock.
class StampClockTest : public ::testing::Test {
 protected:
  /// Goes on for that long with true times plus `wrong_ns`; those from 0 on are taken as images.
  void run(std::int64_t duration_ns, std::int64_t wrong_ns = 0) {
    for (const std::int64_t end_ns = true_ns_ + duration_ns; true_ns_ < end_ns;) {
      add(true_ns_ + wrong_ns);
    }
  }
  void add(std::int64_t stamp_ns) {
    const std::int64_t time_ns = clock_.time_of(stamp_ns, true_ns_ - kBegin + kDelay);
    EXPECT_GT(time_ns, times_.empty() ? 0 : times_.back());
    times_.push_back(time_ns);
    largest_error_ns_ = std::max(largest_error_ns_, std::abs(time_ns - true_ns_));
    true_ns_ += kFrame;
  }

  static constexpr std::int64_t kMs = 1'000'000;
  static constexpr std::int64_t kSecond = 1000 * kMs;
  static constexpr std::int64_t kBegin = 1'700'000'000 * kSecond;  // of the stamps' clock
  static constexpr std::int64_t kFrame = 50 * kMs;
  static constexpr std::int64_t kDelay = 20 * kMs;

  const test::CapturedLog log_;
  StampClock clock_{"topic /eye", kFateOfImages};
  std::int64_t true_ns_ = kBegin;
  std::vector<std::int64_t> times_;
  std::int64_t largest_error_ns_ = 0;
};

TEST_F(StampClockTest, StampsThatFitAreTheTimes) {
  run(5 * kSecond);
  EXPECT_EQ(largest_error_ns_, 0);
  EXPECT_EQ(clock_.misfits(), 0U);
  EXPECT_THAT(log_.lines("topic"), SizeIs(0));
}

/// As an OAK camera's node does.
TEST_F(StampClockTest, AJumpThatIsTakenBackIsPassedOver) {
  run(2 * kSecond);
  run(kSecond / 2, 5 * kSecond);
  run(2 * kSecond);
  run(kSecond / 2, -5 * kSecond);
  run(2 * kSecond);
  EXPECT_LE(largest_error_ns_, kMs);
  EXPECT_EQ(clock_.misfits(), 20U);
  EXPECT_EQ(clock_.jumped_ns(), 0);
  EXPECT_THAT(log_.lines("topic /eye: the stamp"), SizeIs(1));
}

/// As a RealSense camera's does every 71 minutes, when its 32 bits of microseconds wrap around.
TEST_F(StampClockTest, AJumpThatStaysIsFollowedAfterASecond) {
  constexpr std::int64_t kWrap = (std::int64_t{1} << 32U) * 1000;
  run(2 * kSecond);
  run(5 * kSecond, -kWrap);
  EXPECT_LE(largest_error_ns_, kMs);
  EXPECT_NEAR(static_cast<double>(clock_.misfits()), 20, 2);
  EXPECT_NEAR(static_cast<double>(clock_.jumped_ns()), static_cast<double>(-kWrap), kMs);
  run(5 * kSecond, 3 * kSecond);
  EXPECT_LE(largest_error_ns_, kMs);
  EXPECT_NEAR(static_cast<double>(clock_.jumped_ns()), 3.0 * kSecond, kMs);
  EXPECT_THAT(log_.lines("topic /eye: the stamps have jumped"), SizeIs(2));
}

TEST_F(StampClockTest, StampsThatStandStillOrAreNoneNeverJump) {
  run(2 * kSecond);
  const std::int64_t still_ns = true_ns_;
  for (int i = 0; i < 100; ++i) add(still_ns);
  for (int i = 0; i < 100; ++i) add(0);
  for (int i = 0; i < 100; ++i) add(-5);
  EXPECT_LE(largest_error_ns_, kMs);
  EXPECT_GE(clock_.misfits(), 299U);
  EXPECT_EQ(clock_.jumped_ns(), 0);
}

TEST_F(StampClockTest, WithoutAnyStampTheTimesAreTheArrivals) {
  for (int i = 0; i < 100; ++i) add(0);
  EXPECT_EQ(times_.back() - times_.front(), 99 * kFrame);
  EXPECT_EQ(times_.front(), kDelay);
}

/// The reader was held up for 5 s, and then finds the images of that time.
TEST_F(StampClockTest, StampsOfABacklogFit) {
  run(2 * kSecond);
  const std::int64_t late_ns = true_ns_ + 5 * kSecond - kBegin;
  for (; true_ns_ - kBegin < late_ns; true_ns_ += kFrame) {
    EXPECT_EQ(clock_.fit(true_ns_, late_ns), true_ns_);
  }
  run(2 * kSecond);
  EXPECT_EQ(largest_error_ns_, 0);
  EXPECT_EQ(clock_.misfits(), 0U);
}

TEST_F(StampClockTest, StampsOfABacklogFitAtTheStart) {
  const std::int64_t late_ns = 5 * kSecond;
  for (; true_ns_ - kBegin < late_ns; true_ns_ += kFrame) {
    EXPECT_EQ(clock_.fit(true_ns_, late_ns), true_ns_);
  }
  run(2 * kSecond);
  EXPECT_EQ(largest_error_ns_, 0);
  EXPECT_EQ(clock_.misfits(), 0U);
}

TEST_F(StampClockTest, ASampleWhoseStampDoesNotFitHasNoTime) {
  run(2 * kSecond);
  const std::int64_t arrival_ns = true_ns_ - kBegin + kDelay;
  EXPECT_FALSE(clock_.fit(true_ns_ + 30 * 365 * 86400 * kSecond, arrival_ns));
  EXPECT_FALSE(clock_.fit(std::numeric_limits<std::int64_t>::max(), arrival_ns));
  EXPECT_FALSE(clock_.fit(std::numeric_limits<std::int64_t>::min(), arrival_ns));
  EXPECT_FALSE(clock_.fit(times_.back(), arrival_ns));
  EXPECT_EQ(clock_.fit(true_ns_, arrival_ns), true_ns_);
}

/// Its clock may well be another, but the first stamp alone does not say so.
TEST_F(StampClockTest, WhatIsExpectedOfTheFirstStampIsLearntAnewWithinASecond) {
  clock_.expect_delay(kDelay - kBegin);
  EXPECT_FALSE(clock_.fit(kBegin + 30 * kSecond, kDelay));
  EXPECT_EQ(clock_.fit(kBegin, kDelay), kBegin);
  StampClock other("imu0", "the sample is lost");
  other.expect_delay(kDelay - kBegin);
  std::int64_t at_ns = 0;
  while (!other.fit(kBegin + at_ns + 30 * kSecond, kDelay + at_ns)) at_ns += 5 * kMs;
  EXPECT_EQ(at_ns, kSecond);
  EXPECT_EQ(other.jumped_ns(), 0);
}

}  // namespace
}  // namespace orbbuf
