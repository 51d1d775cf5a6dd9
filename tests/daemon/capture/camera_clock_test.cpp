// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "daemon/capture/camera_source.hpp"

namespace orbbuf {
namespace {

constexpr std::int64_t kSecond = 1'000'000'000;

TEST(CaptureClock, StampsAreMovedByTheOffsetOfTheStart) {
  CaptureClock clock;
  EXPECT_TRUE(clock.follow({.monotonic_ns = 100, .utc_ns = 1'000'100, .asleep_ns = 500}));
  EXPECT_EQ(clock.offset_ns(), 1'000'000);
  EXPECT_EQ(clock.utc_ns(150), 1'000'150);
  EXPECT_EQ(clock.utc_ns(250), 1'000'250);
}

TEST(CaptureClock, StepsOfTheSystemsClockDoNotShow) {
  CaptureClock clock;
  clock.follow({0, 50 * kSecond, 7 * kSecond});
  EXPECT_FALSE(clock.follow({10 * kSecond, 40 * kSecond, 7 * kSecond}));
  EXPECT_FALSE(clock.follow({10 * kSecond, 3600 * kSecond, 7 * kSecond + 9'999'999}));
  EXPECT_FALSE(clock.follow({10 * kSecond, 60 * kSecond, 7 * kSecond - 9'999'999}));
  EXPECT_EQ(clock.offset_ns(), 50 * kSecond);
}

TEST(CaptureClock, TheOffsetGrowsByTheTimeAsleep) {
  CaptureClock clock;
  clock.follow({0, 50 * kSecond, 7 * kSecond});
  EXPECT_TRUE(clock.follow({1 * kSecond, 3600 * kSecond, 17 * kSecond}));
  EXPECT_EQ(clock.offset_ns(), 60 * kSecond);
  EXPECT_EQ(clock.utc_ns(2 * kSecond), 62 * kSecond);
  EXPECT_FALSE(clock.follow({3 * kSecond, 3602 * kSecond, 17 * kSecond}));
  EXPECT_TRUE(clock.follow({4 * kSecond, 0, 18 * kSecond}));
  EXPECT_EQ(clock.offset_ns(), 61 * kSecond);
}

TEST(CaptureClock, TheClocksAreReadTogether) {
  const auto first = read_clocks();
  const auto second = read_clocks();
  EXPECT_LE(first.monotonic_ns, second.monotonic_ns);
  EXPECT_GT(first.utc_ns, kSecond);
  EXPECT_NEAR(static_cast<double>(second.asleep_ns - first.asleep_ns), 0, 9'999'999);
}

TEST(GapCounter, WhatIsLeftOutIsMissed) {
  GapCounter gaps;
  EXPECT_EQ(gaps.missed_before(7), 0U);
  EXPECT_EQ(gaps.missed_before(8), 0U);
  EXPECT_EQ(gaps.missed_before(12), 3U);
}

TEST(GapCounter, NumbersWrapAround) {
  GapCounter gaps;
  gaps.missed_before(0xFFFFFFFE);
  EXPECT_EQ(gaps.missed_before(1), 2U);
}

TEST(GapCounter, ADriverThatDoesNotCountMissesNothing) {
  GapCounter gaps;
  for (int i = 0; i < 3; ++i) EXPECT_EQ(gaps.missed_before(0), 0U);
  gaps.missed_before(100);
  EXPECT_EQ(gaps.missed_before(3), 0U);
  EXPECT_EQ(gaps.missed_before(5), 1U);
}

TEST(GapCounter, ANewStreamBeginsAnywhere) {
  GapCounter gaps;
  gaps.missed_before(3);
  gaps.start();
  EXPECT_EQ(gaps.missed_before(50), 0U);
}

}  // namespace
}  // namespace orbbuf
