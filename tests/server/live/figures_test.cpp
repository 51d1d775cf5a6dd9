// SPDX-License-Identifier: Apache-2.0
#include "server/live/figures.hpp"

#include <gtest/gtest.h>

#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using namespace std::chrono_literals;

RobotFigures::Time at(std::chrono::nanoseconds time) { return RobotFigures::Time(1h + time); }

FramePtr frame(Sequence sequence) {
  return std::make_shared<const EncodedFrame>(test::plain_frame(sequence));
}

TEST(RobotFigures, CountWhatIsTakenAndKeepTheNewestFrame) {
  RobotFigures robot({"r", "s", ""});
  robot.connected(at(0s));
  robot.delivered(frame(0), at(1s));
  robot.delivered(frame(1), at(2s));
  const std::vector<DropRecord> drops(3);
  robot.dropped(drops, at(2s));
  EXPECT_EQ(robot.frames(), 2U);
  EXPECT_EQ(robot.drops(), 3U);
  EXPECT_EQ(robot.bytes(), frame(0)->jpeg.size() + frame(1)->jpeg.size());
  EXPECT_EQ(robot.newest()->sequence, 1U);
}

TEST(RobotFigures, KeepNoFrameThatNobodyCanSee) {
  Figures figures(1, false);
  const auto robot = figures.begin({"r", "s", ""});
  robot->delivered(frame(0), at(1s));
  EXPECT_EQ(robot->frames(), 1U);
  EXPECT_EQ(robot->newest(), nullptr);
}

TEST(RobotFigures, TheFrameRateIsThatOfTheLastSecondsAndFallsWithSilence) {
  RobotFigures robot({"r", "s", ""});
  EXPECT_EQ(robot.frame_rate(at(0s)), 0);
  for (int i = 0; i < 50; ++i) robot.delivered(frame(0), at(i * 40ms));
  EXPECT_NEAR(robot.frame_rate(at(1960ms)), 25, 1);
  EXPECT_NEAR(robot.frame_rate(at(26s)), 1, 0.1);
  robot.ended(at(27s));
  EXPECT_EQ(robot.frame_rate(at(27s)), 0);
}

TEST(RobotFigures, KnowWhetherTheRobotIsThere) {
  RobotFigures robot({"r", "s", ""});
  EXPECT_FALSE(robot.is_connected());
  robot.connected(at(0s));
  EXPECT_TRUE(robot.is_connected());
  robot.disconnected();
  EXPECT_FALSE(robot.is_connected());
  EXPECT_FALSE(robot.is_ended());
  robot.connected(at(1s));
  EXPECT_EQ(robot.connections(), 2U);
  robot.ended(at(2s));
  EXPECT_FALSE(robot.is_connected());
  EXPECT_TRUE(robot.is_ended());
}

TEST(Figures, ANewSessionTakesThePlaceOfTheRobotsEarlierOne) {
  Figures figures(4);
  const auto first = figures.begin({"r", "s1", ""});
  first->delivered(frame(0), at(0s));
  const auto second = figures.begin({"r", "s2", ""});
  ASSERT_EQ(figures.robots().size(), 1U);
  EXPECT_EQ(figures.robots().at("r"), second);
  EXPECT_EQ(second->frames(), 0U);
}

TEST(Figures, OfRobotsThatAreGoneTheLongestGoneIsForgottenFirst) {
  Figures figures(2);
  figures.begin({"a", "s", ""})->ended(at(2s));
  figures.begin({"b", "s", ""})->ended(at(1s));
  figures.begin({"c", "s", ""});
  EXPECT_TRUE(figures.robots().contains("a"));
  EXPECT_FALSE(figures.robots().contains("b"));
  figures.begin({"d", "s", ""});
  figures.begin({"e", "s", ""});
  EXPECT_EQ(figures.robots().size(), 3U) << "those that are here are shown, however many";
}

}  // namespace
}  // namespace orbbuf
