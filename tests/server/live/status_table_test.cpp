// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include <memory>

#include "server/live/metrics.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf::test {
namespace {

using testing::EndsWith;
using testing::HasSubstr;
using testing::MatchesRegex;
using testing::Not;

TEST(StatusTable, HasALineForEachRobot) {
  Metrics metrics(8);
  const auto robot = metrics.begin({"tb3", "s1", ""});
  robot->on_connected();
  robot->on_report({{120, 1, 2, 10, 100, 7, 0}, 25, 1000, 1'500'000, 40'000});
  robot->on_late(true);
  robot->on_spool(4, 9);
  metrics.begin({"silent", "s2", ""})->on_ended();
  const std::string table = to_table(metrics, RobotMetrics::Clock::now());
  EXPECT_THAT(table, HasSubstr("ROBOT   SESSION  STATE      FRAMES/S  AGE  BUFFER"));
  EXPECT_THAT(table, HasSubstr("FAILED  LATE  ON ROBOT  QUALITY  REDUCED\n"));
  EXPECT_THAT(table, HasSubstr("silent  s2       ended           0.0    -       -"));
  EXPECT_THAT(table, HasSubstr("tb3     s1       connected       0.0    -    7/25  1.50 MB/s"));
  EXPECT_THAT(table, HasSubstr(" 40.0 ms       120        100       10        1       2     1    "
                               "   4/9        -        0\n"));
}

TEST(StatusTable, TellsTheNewestQualityAndHowManyFramesAreReduced) {
  Metrics metrics(1);
  const auto robot = metrics.begin({"tb3", "s1", ""});
  for (Sequence i = 0; i < 2; ++i) {
    robot->on_delivered(std::make_shared<EncodedFrame>(reduced_frame(i)), RobotMetrics::Time());
  }
  EXPECT_THAT(to_table(metrics, RobotMetrics::Time()), HasSubstr("       30        2\n"));
}

TEST(StatusTable, HasALineForEachStreamOfSamples) {
  const RobotMetrics::Time begin{std::chrono::hours(1)};
  Metrics metrics(8);
  const auto robot = metrics.begin({"tb3", "s1", "", {{4, "imu0", "imu"}, {5, "imu_rear", "imu"}}});
  wire::Report report;
  report.captured_items[4] = 470;
  robot->on_report(report, begin);
  robot->on_samples("imu0", 0, 0, std::vector<Sample>(250), begin);
  robot->on_samples("imu0", 250, 260, std::vector<Sample>(200), begin + std::chrono::seconds(1));
  EXPECT_THAT(to_table(metrics, begin + std::chrono::milliseconds(1003)),
              EndsWith("\n\n"
                       "ROBOT  STREAM    SAMPLES/S   AGE  CAPTURED  DELIVERED  WAITING  LOST\n"
                       "tb3    imu0          250.0  3 ms       470        450       10    10\n"
                       "tb3    imu_rear        0.0     -         0          0        0     0\n"));
}

TEST(StatusTable, TellsWhyARobotsStreamIsPaused) {
  Metrics metrics(1);
  const auto robot = metrics.begin({"tb3", "s1", ""});
  robot->on_connected();
  robot->on_paused("write x: No space left on device");
  const auto table = to_table(metrics, RobotMetrics::Clock::now());
  EXPECT_THAT(table, HasSubstr("tb3    s1       paused "));
  EXPECT_THAT(table, EndsWith("\n\ntb3: paused: write x: No space left on device\n"));
  robot->on_resumed();
  EXPECT_THAT(to_table(metrics, RobotMetrics::Clock::now()), Not(HasSubstr("paused")));
}

TEST(StatusTable, HasItsHeadingWithoutRobots) {
  EXPECT_THAT(to_table(Metrics(1), RobotMetrics::Time()),
              MatchesRegex("ROBOT .*FAILED  LATE  ON ROBOT  QUALITY  REDUCED\n"));
}

}  // namespace
}  // namespace orbbuf::test
