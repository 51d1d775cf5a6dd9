// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <limits>

#include "server/live/metrics.hpp"

namespace orbbuf {
namespace {

using namespace std::chrono_literals;
using std::chrono::nanoseconds;

/// A robot whose clock is `kAhead` of ours, and frames that take 10 ms at the least.
class TimelineTest : public testing::Test {
 protected:
  static constexpr std::int64_t kAhead = 1'000'000'000'000'000'000;

  static Timeline::Time at(nanoseconds time) { return Timeline::Time(1h + time); }
  static std::int64_t robot_ns(nanoseconds time) { return kAhead + time.count(); }
  void deliver(nanoseconds captured, nanoseconds arrived) {
    timeline_.on_heard(at(arrived), false);
    timeline_.on_delivered(robot_ns(captured), at(arrived));
  }
  void drop(nanoseconds captured, std::uint16_t similarity = kUnknownSimilarity) {
    timeline_.on_dropped({0, robot_ns(captured), DropReason::kPolicy, similarity}, at(0s));
  }

  Timeline timeline_;
};

TEST_F(TimelineTest, CountsBySecondOfCapture) {
  deliver(0ms, 10ms);
  deliver(900ms, 915ms);
  deliver(2100ms, 2110ms);
  drop(950ms, 80);
  drop(960ms, 40);
  drop(970ms);
  ASSERT_EQ(timeline_.seconds().size(), 2U);
  const TimelineSecond& first = timeline_.seconds()[0];
  EXPECT_EQ(first.second, kAhead / 1'000'000'000);
  EXPECT_EQ(first.delivered, 2U);
  EXPECT_EQ(first.dropped, 3U);
  EXPECT_EQ(first.similarity, 40U);
  EXPECT_EQ(first.delay_ms, 5U);
  EXPECT_EQ(timeline_.seconds()[1].delivered, 1U);
  EXPECT_EQ(timeline_.seconds()[1].similarity, kUnknownSimilarity);
}

TEST_F(TimelineTest, CountsTheFramesOfARangeInTheirSeconds) {
  DropRecord range{7, robot_ns(500ms), DropReason::kBusy};
  range.frames = 20;
  range.last_capture_time_ns = robot_ns(2400ms);  // ten a second
  timeline_.on_dropped(range, at(0s));
  ASSERT_EQ(timeline_.seconds().size(), 3U);
  EXPECT_EQ(timeline_.seconds()[0].dropped, 5U);
  EXPECT_EQ(timeline_.seconds()[1].dropped, 10U);
  EXPECT_EQ(timeline_.seconds()[2].dropped, 5U);
}

TEST_F(TimelineTest, ARangeOfAnyLengthIsCounted) {
  DropRecord range{0, robot_ns(0s), DropReason::kUnknown};
  range.frames = std::numeric_limits<std::uint64_t>::max();
  range.last_capture_time_ns = robot_ns(999ms);
  timeline_.on_dropped(range, at(0s));
  EXPECT_EQ(timeline_.seconds().size(), 1U);
  range.frames = 1'000'000;
  timeline_ = {};
  timeline_.on_dropped(range, at(0s));
  EXPECT_EQ(timeline_.seconds()[0].dropped, 1'000'000U);
}

TEST_F(TimelineTest, TheFastestFrameIsTheMeasureOfTheRobotsClock) {
  EXPECT_FALSE(timeline_.age(at(0s)));
  deliver(0ms, 50ms);
  deliver(40ms, 50ms);
  EXPECT_EQ(timeline_.age(at(1050ms)), 1s);
  EXPECT_EQ(timeline_.robot_time(at(50ms)).count(), robot_ns(40ms));
}

TEST_F(TimelineTest, WhatWasFastLongAgoIsForgotten) {
  deliver(0s, 0s);
  deliver(61s, 62s);
  EXPECT_EQ(timeline_.age(at(62s)), 1s);
  deliver(122s, 123s);
  EXPECT_EQ(timeline_.age(at(123s)), 0s);
}

TEST_F(TimelineTest, FramesThatWaitedThroughASilenceShowAnOutage) {
  deliver(0ms, 10ms);
  deliver(40ms, 3050ms);
  deliver(3020ms, 3060ms);
  ASSERT_EQ(timeline_.outages().size(), 1U);
  EXPECT_EQ(timeline_.outages()[0].begin.count(), robot_ns(0ms));
  EXPECT_EQ(timeline_.outages()[0].end.count(), robot_ns(3040ms));
}

TEST_F(TimelineTest, ARobotThatHadNothingToSayIsNoOutage) {
  deliver(0ms, 10ms);
  deliver(30s, 30'010ms);
  EXPECT_TRUE(timeline_.outages().empty());
}

TEST_F(TimelineTest, ASilenceThatANewConnectionEndsIsAnOutage) {
  deliver(0ms, 10ms);
  timeline_.on_heard(at(4s), true);
  deliver(4s, 4010ms);
  ASSERT_EQ(timeline_.outages().size(), 1U);
  EXPECT_EQ(timeline_.outages()[0].end - timeline_.outages()[0].begin, 4s);
}

TEST_F(TimelineTest, KeepsTwoMinutesAndSoManyOutages) {
  for (int i = 0; i < 500; ++i) deliver(i * 3s, i * 3s + 10ms + (i % 2) * 1s);
  EXPECT_LE(timeline_.seconds().size(), static_cast<std::size_t>(Timeline::kSeconds));
  EXPECT_EQ(timeline_.outages().size(), Timeline::kOutages);
  EXPECT_GT(timeline_.seconds().front().second,
            timeline_.seconds().back().second - Timeline::kSeconds);
}

TEST_F(TimelineTest, DropsOfOtherTimesAreNotCounted) {
  deliver(200s, 200s);
  drop(1s);
  drop(500s);
  EXPECT_EQ(timeline_.seconds().size(), 1U);
}

TEST_F(TimelineTest, AClockThatIsSetBeginsItAnew) {
  deliver(1000s, 1000s);
  deliver(3s, 1001s);
  ASSERT_EQ(timeline_.seconds().size(), 1U);
  EXPECT_EQ(timeline_.seconds()[0].second, kAhead / 1'000'000'000 + 3);
}

TEST_F(TimelineTest, NoTimeIsTooStrange) {
  constexpr auto kMax = std::numeric_limits<std::int64_t>::max();
  constexpr auto kMin = std::numeric_limits<std::int64_t>::min();
  auto now = at(0s);
  for (const std::int64_t time : {kMin, kMax, std::int64_t{0}, kMax, kMin, std::int64_t{-1}}) {
    timeline_.on_heard(now += 1s, false);
    timeline_.on_dropped({0, time, DropReason::kBusy}, now);
    timeline_.on_delivered(time, now);
    EXPECT_TRUE(timeline_.age(now));
    EXPECT_LE(timeline_.seconds().size(), static_cast<std::size_t>(Timeline::kSeconds));
  }
}

}  // namespace
}  // namespace orbbuf
