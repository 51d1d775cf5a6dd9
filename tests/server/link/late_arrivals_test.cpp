// SPDX-License-Identifier: Apache-2.0
#include "server/link/late_arrivals.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "server/recording/file_io.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/link/listener_fixture.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using test::ListenerTest;
using test::plain_frame;
using test::read_lines;
using test::RobotClient;
using wire::ErrorCode;

/// A whole server; the robot of the test sends late frames.
class LateArrivalsTest : public ListenerTest {
 protected:
  /// In parts of `step` bytes.
  static void send_late(const RobotClient& robot, std::uint64_t number, const std::string& session,
                        Sequence sequence, std::size_t step = 1000) {
    const auto record = wire::encode_late_record(session, plain_frame(sequence, 2500));
    for (std::size_t offset = 0; offset < record.size(); offset += step) {
      const auto part = std::span(record).subspan(offset);
      robot.send(wire::encode(wire::LatePart{number, static_cast<std::uint32_t>(offset),
                                             static_cast<std::uint32_t>(record.size()),
                                             part.first(std::min(step, part.size()))}));
    }
  }
  static void say_spool(const RobotClient& robot, std::vector<wire::SpooledSession> sessions) {
    robot.send(wire::encode(wire::Spool{std::move(sessions)}));
  }
  static bool late_acked(const RobotClient& robot, std::uint64_t next) {
    for (std::uint64_t acked = 0; acked < next;) {
      const auto ack = robot.late_ack();
      if (!ack) return false;
      acked = ack->next;
    }
    return true;
  }
  fs::path session(const std::string& name) const { return folder_ / "data" / "r" / name; }
  /// A session of frames 0 and 3, which the robot has ended.
  void record(const std::string& name) {
    const auto robot = connect();
    ASSERT_TRUE(robot.hello("r", name));
    for (const Sequence sequence : {0U, 3U}) robot.send_frame(plain_frame(sequence, 2500));
    ASSERT_TRUE(robot.acked(4));
    robot.send(
        wire::encode(wire::Dropped{0, {{1, 1, DropReason::kPolicy}, {2, 2, DropReason::kPolicy}}}));
    ASSERT_TRUE(robot.ack());
    robot.send(wire::encode(wire::Bye{{4, 2}}));
    while (robot.ack()) {
    }
  }
  static std::vector<std::string> numbers(const std::vector<std::string>& lines) {
    std::vector<std::string> numbers;
    for (const std::string& line : lines) numbers.push_back(line.substr(0, line.find(' ')));
    return numbers;
  }
};

TEST_F(LateArrivalsTest, ALateFrameIsKeptBesideTheLiveOnesAndAcknowledged) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  robot.send_frame(plain_frame(1, 100));
  ASSERT_TRUE(robot.acked(2));
  send_late(robot, 0, "s", 0);
  EXPECT_TRUE(late_acked(robot, 1));
  EXPECT_EQ(read_file(session("s") / "late" / "images" / "000000.jpg").value(),
            plain_frame(0, 2500).jpeg);
  EXPECT_EQ(numbers(read_lines(session("s") / "times.txt")), std::vector<std::string>{"1"});
}

TEST_F(LateArrivalsTest, LiveFramesGoOnBetweenTheParts) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  const auto record = wire::encode_late_record("s", plain_frame(0, 2500));
  const auto bytes = static_cast<std::uint32_t>(record.size());
  robot.send(wire::encode(wire::LatePart{0, 0, bytes, std::span(record).first(1000)}));
  robot.send_frame(plain_frame(1, 100));
  EXPECT_TRUE(robot.acked(2));
  robot.send(wire::encode(wire::LatePart{0, 1000, bytes, std::span(record).subspan(1000)}));
  EXPECT_TRUE(late_acked(robot, 1));
}

TEST_F(LateArrivalsTest, AnEarlierSessionIsMergedWhenTheRobotHoldsNoMoreOfIt) {
  record("earlier");
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "present"));
  say_spool(robot, {{"earlier", 2, 1}});
  send_late(robot, 0, "earlier", 2);
  send_late(robot, 1, "earlier", 1);
  ASSERT_TRUE(late_acked(robot, 2));
  EXPECT_TRUE(fs::exists(session("earlier") / "late"));
  say_spool(robot, {});
  log_.wait_for("r earlier: 2 late frames have completed the session");
  EXPECT_EQ(numbers(read_lines(session("earlier") / "times.txt")),
            (std::vector<std::string>{"0", "1", "2", "3"}));
  EXPECT_FALSE(fs::exists(session("earlier") / "late"));
  EXPECT_EQ(read_file(session("earlier") / "images" / "000001.jpg").value(),
            plain_frame(1, 2500).jpeg);
  const auto drops = read_lines(session("earlier") / "drops.csv");
  ASSERT_EQ(drops.size(), 3U);
  EXPECT_TRUE(drops[1].starts_with("1,late,")) << drops[1];
}

TEST_F(LateArrivalsTest, ThePresentSessionIsMergedWhenItHasEnded) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  robot.send_frame(plain_frame(1, 100));
  ASSERT_TRUE(robot.acked(2));
  say_spool(robot, {{"s", 1, 0}});
  send_late(robot, 0, "s", 0);
  ASSERT_TRUE(late_acked(robot, 1));
  say_spool(robot, {});
  robot.send_frame(plain_frame(2, 100));
  ASSERT_TRUE(robot.acked(3));
  EXPECT_TRUE(fs::exists(session("s") / "late"));
  robot.send(wire::encode(wire::Bye{{3, 0}}));
  log_.wait_for("r s: 1 late frames have completed the session");
  EXPECT_EQ(numbers(read_lines(session("s") / "times.txt")),
            (std::vector<std::string>{"0", "1", "2"}));
}

TEST_F(LateArrivalsTest, AfterARestartTheRobotsFirstWordIsEnough) {
  record("earlier");
  {
    const auto robot = connect();
    ASSERT_TRUE(robot.hello("r", "present"));
    send_late(robot, 0, "earlier", 1);
    ASSERT_TRUE(late_acked(robot, 1));
  }
  server_.reset();
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "present"));
  say_spool(robot, {});
  log_.wait_for("r earlier: 1 late frames have completed the session");
}

TEST_F(LateArrivalsTest, ARepeatIsAcknowledgedAndIgnored) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  robot.send_frame(plain_frame(1, 2500));
  ASSERT_TRUE(robot.acked(2));
  send_late(robot, 0, "s", 0);
  send_late(robot, 1, "s", 0);
  send_late(robot, 2, "s", 1);  // delivered live
  EXPECT_TRUE(late_acked(robot, 3));
  EXPECT_EQ(read_lines(session("s") / "late.csv").size(), 2U);  // the header, and frame 0
}

TEST_F(LateArrivalsTest, WithoutFilesLateFramesAreRefused) {
  settings_.sinks.files_enabled = false;
  settings_.sinks.mcap_enabled = true;
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  send_late(robot, 0, "s", 0);
  EXPECT_EQ(robot.error()->code, ErrorCode::kUnexpected);
}

TEST_F(LateArrivalsTest, APartThatIsNotTheNextOneEndsTheConnectionAndNothingElse) {
  const auto robot = connect();
  const auto other = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  ASSERT_TRUE(other.hello("other", "s"));
  send_late(robot, 5, "s", 0);
  EXPECT_EQ(robot.error()->code, ErrorCode::kUnexpected);
  other.send_frame(plain_frame(0, 100));
  EXPECT_TRUE(other.acked(1));
}

TEST_F(LateArrivalsTest, WhatTheRobotHoldsIsInTheSessionsFolder) {
  record("earlier");
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "present"));
  say_spool(robot, {{"earlier", 2, 1}});
  send_late(robot, 0, "earlier", 1);  // behind the note, in the same strand
  ASSERT_TRUE(late_acked(robot, 1));
  const auto lines = read_lines(session("earlier") / "spool.csv");
  ASSERT_EQ(lines.size(), 2U);
  EXPECT_TRUE(lines[1].starts_with("2,1,")) << lines[1];
}

}  // namespace
}  // namespace orbbuf
