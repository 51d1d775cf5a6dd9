// SPDX-License-Identifier: Apache-2.0
#include "server/live/metrics.hpp"

#include <gtest/gtest.h>

#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using namespace std::chrono_literals;

RobotMetrics::Time at(std::chrono::nanoseconds time) { return RobotMetrics::Time(1h + time); }

FramePtr frame(Sequence sequence) {
  return std::make_shared<const EncodedFrame>(test::plain_frame(sequence));
}

TEST(RobotMetrics, CountWhatIsTakenAndKeepTheNewestFrame) {
  RobotMetrics robot({"r", "s", ""});
  robot.on_connected(at(0s));
  robot.on_delivered(frame(0), at(1s));
  robot.on_delivered(frame(1), at(2s));
  std::vector<DropRecord> drops(2);
  drops[1].frames = 2;
  robot.on_dropped(drops, at(2s));
  EXPECT_EQ(robot.frames(), 2U);
  EXPECT_EQ(robot.drops(), 3U);
  EXPECT_EQ(robot.bytes(), frame(0)->jpeg.size() + frame(1)->jpeg.size());
  EXPECT_EQ(robot.newest()->sequence, 1U);
}

TEST(RobotMetrics, CountReducedFramesAndTellTheNewestQuality) {
  RobotMetrics robot({"r", "s", ""});
  EXPECT_EQ(robot.quality(), 0);
  for (const std::uint8_t quality : std::initializer_list<std::uint8_t>{30, 50}) {
    robot.on_delivered(std::make_shared<EncodedFrame>(test::reduced_frame(0, quality)), at(1s));
  }
  EXPECT_EQ(robot.reduced(), 2U);
  EXPECT_EQ(robot.quality(), 50);
  robot.on_delivered(frame(1), at(2s));
  EXPECT_EQ(robot.reduced(), 2U);
  EXPECT_EQ(robot.quality(), 0);
}

TEST(RobotMetrics, KeepNoFrameThatNobodyCanSee) {
  Metrics metrics(1, false);
  const auto robot = metrics.begin({"r", "s", ""});
  robot->on_delivered(frame(0), at(1s));
  EXPECT_EQ(robot->frames(), 1U);
  EXPECT_EQ(robot->newest(), nullptr);
}

TEST(RobotMetrics, TheFrameRateIsThatOfTheLastSecondsAndFallsWithSilence) {
  RobotMetrics robot({"r", "s", ""});
  EXPECT_EQ(robot.frame_rate(at(0s)), 0);
  for (int i = 0; i < 50; ++i) robot.on_delivered(frame(0), at(i * 40ms));
  EXPECT_NEAR(robot.frame_rate(at(1960ms)), 25, 1);
  EXPECT_NEAR(robot.frame_rate(at(26s)), 1, 0.1);
  robot.on_ended(at(27s));
  EXPECT_EQ(robot.frame_rate(at(27s)), 0);
}

TEST(RobotMetrics, KnowWhetherTheRobotIsThere) {
  RobotMetrics robot({"r", "s", ""});
  EXPECT_FALSE(robot.is_connected());
  robot.on_connected(at(0s));
  EXPECT_TRUE(robot.is_connected());
  robot.on_disconnected();
  EXPECT_FALSE(robot.is_connected());
  EXPECT_FALSE(robot.is_ended());
  robot.on_connected(at(1s));
  EXPECT_EQ(robot.connections(), 2U);
  robot.on_ended(at(2s));
  EXPECT_FALSE(robot.is_connected());
  EXPECT_TRUE(robot.is_ended());
}

TEST(RobotMetrics, CountWhatArrivesLate) {
  RobotMetrics robot({"r", "s", ""});
  EXPECT_EQ(robot.on_robot(), std::nullopt);
  robot.on_late(true);
  robot.on_late(false);
  robot.on_late(true);
  robot.on_spool(3, 10);
  EXPECT_EQ(robot.late(), 2U);
  EXPECT_EQ(robot.late_total(), 3U);
  EXPECT_EQ(robot.on_robot(), (RobotMetrics::OnRobot{3, 10}));
  EXPECT_EQ(robot.frames(), 0U);
}

TEST(Metrics, WhatIsOnTheRobotOutlivesTheSession) {
  Metrics metrics(4);
  const auto first = metrics.begin({"r", "s1", ""});
  first->on_late(true);
  first->on_spool(3, 10);
  const auto second = metrics.begin({"r", "s2", ""});
  EXPECT_EQ(second->late(), 0U);
  EXPECT_EQ(second->late_total(), 1U);
  EXPECT_EQ(second->on_robot(), (RobotMetrics::OnRobot{0, 10}));
  EXPECT_EQ(metrics.begin({"other", "s1", ""})->late_total(), 0U);
}

TEST(Metrics, ANewSessionTakesThePlaceOfTheRobotsEarlierOne) {
  Metrics metrics(4);
  const auto first = metrics.begin({"r", "s1", ""});
  first->on_delivered(frame(0), at(0s));
  const auto second = metrics.begin({"r", "s2", ""});
  ASSERT_EQ(metrics.robots().size(), 1U);
  EXPECT_EQ(metrics.robots().at("r"), second);
  EXPECT_EQ(second->frames(), 0U);
}

TEST(Metrics, OfRobotsThatAreGoneTheLongestGoneIsForgottenFirst) {
  Metrics metrics(2);
  metrics.begin({"a", "s", ""})->on_ended(at(2s));
  metrics.begin({"b", "s", ""})->on_ended(at(1s));
  metrics.begin({"c", "s", ""});
  EXPECT_TRUE(metrics.robots().contains("a"));
  EXPECT_FALSE(metrics.robots().contains("b"));
  metrics.begin({"d", "s", ""});
  metrics.begin({"e", "s", ""});
  EXPECT_EQ(metrics.robots().size(), 3U) << "those that are here are shown, however many";
}

TEST(RobotMetricsSamples, AreCountedByTheirStream) {
  RobotMetrics robot({"r", "s", ""});
  const RobotMetrics::Time begin{std::chrono::hours(1)};
  for (std::uint64_t i = 0; i <= 100; ++i) {
    const std::uint64_t expected = 20 * i + (i > 50 ? 3 : 0);
    robot.on_samples("imu0", expected, expected + (i == 50 ? 3 : 0), std::vector<Sample>(20),
                     begin + std::chrono::milliseconds(20 * i));
  }
  robot.on_samples("imu1", 0, 0, std::vector<Sample>(1), begin);
  ASSERT_EQ(robot.streams().size(), 2U);
  const StreamMetrics& stream = robot.streams().at("imu0");
  EXPECT_EQ(stream.samples, 2020U);
  EXPECT_EQ(stream.lost, 3U);
  EXPECT_EQ(stream.age(begin + std::chrono::seconds(3)), std::chrono::seconds(1));
  EXPECT_NEAR(stream.rate.per_second(stream.newest), 1000, 50);
}

TEST(RobotMetricsSamples, ThoseThatTheRobotReportsAndAreNotHereWait) {
  RobotMetrics robot({"r", "s", "", {{4, "imu0", "imu"}}});
  wire::Report report;
  report.captured_items[4] = 50;
  robot.on_report(report);
  const StreamMetrics& stream = robot.streams().at("imu0");
  EXPECT_EQ(stream.waiting(), 50U);
  EXPECT_FALSE(stream.age(RobotMetrics::Clock::now()));
  robot.on_samples("imu0", 0, 10, std::vector<Sample>(30));
  EXPECT_EQ(stream.waiting(), 10U);
  robot.on_samples("imu0", 40, 40, std::vector<Sample>(20));
  EXPECT_EQ(stream.waiting(), 0U) << "the report is older";
}

TEST(RobotMetricsSamples, EachSecondTellsItsLongestGapAndFastestTurn) {
  constexpr std::int64_t kMs = 1'000'000;
  RobotMetrics robot({"r", "s", ""});
  const std::vector<Sample> samples{{500 * kMs, {}, {}},
                                    {510 * kMs, {0, 0, 1}, {}},
                                    {1200 * kMs, {0, 3, 4}, {}},
                                    {1210 * kMs, {1e300, 0, 0}, {}}};
  robot.on_samples("imu0", 0, 7, samples);
  const auto& seconds = robot.streams().at("imu0").seconds;
  ASSERT_EQ(seconds.size(), 2U);
  EXPECT_EQ(seconds[0].samples, 2U);
  EXPECT_EQ(seconds[0].lost, 7U);
  EXPECT_EQ(seconds[0].longest_gap_ms, 10U);
  EXPECT_NEAR(seconds[0].fastest_turn, 57.3, 0.01);
  EXPECT_EQ(seconds[1].lost, 0U);
  EXPECT_EQ(seconds[1].longest_gap_ms, 690U);
  EXPECT_EQ(seconds[1].fastest_turn, 1e6) << "whatever a robot claims";
  for (std::int64_t second = 2; second < 300; ++second) {
    robot.on_samples("imu0", 11, 11, std::vector<Sample>{{second * 1000 * kMs, {}, {}}});
  }
  EXPECT_EQ(seconds.size(), std::size_t{Timeline::kSeconds});
  EXPECT_EQ(seconds.front().second, 180);
  for (const std::int64_t time : {std::numeric_limits<std::int64_t>::max(), std::int64_t{0},
                                  std::numeric_limits<std::int64_t>::min()}) {
    robot.on_samples("imu0", 12, 12, std::vector<Sample>{{time, {}, {}}});
    ASSERT_EQ(seconds.size(), 1U) << "the clock was set";
    EXPECT_EQ(seconds[0].longest_gap_ms, 0U);
  }
}

}  // namespace
}  // namespace orbbuf
