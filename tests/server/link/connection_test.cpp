// SPDX-License-Identifier: Apache-2.0
#include "server/link/connection.hpp"

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>

#include <limits>
#include <memory>
#include <utility>

#include "testing/captured_log.hpp"
#include "testing/robot_client.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/running_server.hpp"

namespace orbbuf {
namespace {

using test::plain_frame;
using test::reduced_frame;
using test::RobotClient;
using testing::HasSubstr;
using testing::StartsWith;
using wire::ErrorCode;

class ConnectionTest : public testing::Test {
 protected:
  /// The test may be held up for longer than a server waits. Each frame is acknowledged at once, so
  /// that a test can count the acks.
  ConnectionTest() {
    settings_.sinks.files_path = folder_.path();
    settings_.sinks.files_sync = Durability::kSecond;
    settings_.listen.hello_timeout = settings_.listen.idle_timeout = std::chrono::minutes(10);
  }

  RobotClient connect() {
    if (!server_) server_ = std::make_unique<test::RunningServer>(settings_);
    return RobotClient(server_->port());
  }
  std::filesystem::path image(int sequence) const {
    return folder_ / fmt::format("r1/s1/images/{:06}.jpg", sequence);
  }
  /// By the first account.
  static void name_session(const RobotClient& robot, const std::string& session,
                           std::uint64_t captured) {
    wire::Account account;
    account.session_id = session;
    account.captured = captured;
    robot.send_account(0, account);
  }
  /// The one warning that a bad peer is worth.
  std::string warning() {
    server_->stop();
    const auto lines = log_.lines("warning");
    EXPECT_EQ(lines.size(), 1U);
    return lines.empty() ? "" : lines[0];
  }
  /// The connection ended with this error and nothing else happened.
  void expect_end(const RobotClient& robot, ErrorCode code, const std::string& text) {
    const auto error = robot.error();
    ASSERT_TRUE(error);
    EXPECT_EQ(error->code, code);
    EXPECT_THAT(error->text, HasSubstr(text));
    EXPECT_TRUE(robot.is_closed());
  }

  test::TemporaryFolder folder_;
  test::CapturedLog log_;
  Settings settings_;
  std::unique_ptr<test::RunningServer> server_;
};

TEST_F(ConnectionTest, FramesAreAckedWhenTheyAreOnDisk) {
  const auto robot = connect();
  EXPECT_EQ(robot.hello("r1", "s1"), wire::Position{});
  for (Sequence i = 0; i < 20; ++i) robot.send_frame(plain_frame(i, 70'000));
  ASSERT_TRUE(robot.acked(20));
  EXPECT_EQ(test::read_file(image(19)), test::as_text(plain_frame(19, 70'000).jpeg));
  EXPECT_EQ(test::read_lines(folder_ / "r1/s1/times.txt").size(), 20U);
}

TEST_F(ConnectionTest, ARepeatIsAckedAndNotWrittenTwice) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send_frame(plain_frame(0));
  EXPECT_EQ(robot.ack(), (wire::Position{1, 0}));
  robot.send_frame(plain_frame(0));
  EXPECT_EQ(robot.ack(), (wire::Position{1, 0}));
  EXPECT_EQ(test::read_lines(folder_ / "r1/s1/times.txt").size(), 1U);
}

TEST_F(ConnectionTest, DropRecordsAreAckedAndStatsAreNot) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send(wire::encode(wire::Report{{5, 1, 1, 1, 1, 1, 0}}));
  robot.send_drops(0, {{3, 0, DropReason::kPolicy}, {4, 0, DropReason::kBusy}});
  EXPECT_EQ(robot.ack(), (wire::Position{0, 2}));
  robot.send(wire::encode(wire::Bye{{5, 2}}));
  ASSERT_TRUE(robot.bye());
  EXPECT_EQ(test::read_lines(folder_ / "r1/s1/drops.csv").size(), 3U);
}

TEST_F(ConnectionTest, AByeIsAnsweredWithTheRecordAndTheEnd) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send_frame(plain_frame(8));
  ASSERT_TRUE(robot.acked(9));
  robot.send(wire::encode(wire::Bye{{9, 0}}));
  EXPECT_EQ(robot.bye(), (wire::Position{9, 0}));
  EXPECT_TRUE(robot.is_closed());
}

TEST_F(ConnectionTest, AStrangerSpeakingHttpIsToldSo) {
  const auto stranger = connect();
  stranger.send_text("GET / HTTP/1.1\r\nHost: example.org\r\nUser-Agent: curl/7.88.1\r\n\r\n");
  expect_end(stranger, ErrorCode::kMalformed, "not an ORBBuf peer");
  const std::string line = warning();
  EXPECT_THAT(line, StartsWith("warning - 127.0.0.1:"));
  EXPECT_THAT(line, HasSubstr("\"GET \""));
}

TEST_F(ConnectionTest, AHeaderThatClaimsFourGigabytesIsRefusedAtOnce) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  auto head = wire::encode_frame_head(plain_frame(0));
  for (std::size_t i = 8; i < 12; ++i) head[i] = 0xFF;  // the length of the body
  const std::uint32_t crc = wire::crc32(std::span(head).first(16));
  for (std::size_t i = 0; i < 4; ++i) head[16 + i] = static_cast<std::uint8_t>(crc >> (24 - 8 * i));
  robot.send(head);
  expect_end(robot, ErrorCode::kTooLarge, "4294967295");
  EXPECT_THAT(warning(), StartsWith("warning r1 127.0.0.1:"));
}

TEST_F(ConnectionTest, ARobotThatSaysHelloAndThenNothingIsDisconnected) {
  settings_.listen.idle_timeout = std::chrono::milliseconds(50);
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  expect_end(robot, ErrorCode::kTimeout, "nothing came for 0.05 s");
  EXPECT_THAT(warning(), HasSubstr("nothing came"));
}

TEST_F(ConnectionTest, EveryMessageGivesTheRobotTheIdleTimeAnew) {
  using Clock = std::chrono::steady_clock;
  const auto limit = settings_.listen.idle_timeout = std::chrono::milliseconds(500);
  // Sends for twice as long. False if the test itself was held up, which is no finding.
  const auto holds_out = [&](const RobotClient& robot, Sequence next) {
    auto sent = Clock::now();
    for (const auto begin = sent; Clock::now() - begin < 2 * limit;) {
      const auto before = std::exchange(sent, Clock::now());
      robot.send_frame(plain_frame(next));
      if (robot.acked(++next)) continue;
      EXPECT_GE(Clock::now() - before, limit);
      return false;
    }
    expect_end(robot, ErrorCode::kTimeout, "nothing came for 0.5 s");
    return true;
  };
  for (int attempt = 0; attempt < 20 && !HasFailure(); ++attempt) {
    const auto robot = connect();
    const auto position = robot.hello("r1", "s1");
    ASSERT_TRUE(position);
    if (holds_out(robot, (*position)[wire::kFrames])) return;
  }
  FAIL() << "no attempt of 20 sent its frames within the idle time of each other";
}

TEST_F(ConnectionTest, WhoeverSaysNothingAtAllIsDisconnected) {
  settings_.listen.hello_timeout = std::chrono::milliseconds(50);
  expect_end(connect(), ErrorCode::kTimeout, "no hello within 0.05 s");
}

TEST_F(ConnectionTest, AHelloByteByByteDoesNotStretchItsTime) {
  settings_.listen.hello_timeout = std::chrono::milliseconds(100);
  const auto robot = connect();
  const auto hello = wire::encode(wire::Hello{6, 6, "r1", "s1", "", "", {}});
  const auto has_answer = [&] {
    pollfd events{robot.fd(), POLLIN, 0};
    return ::poll(&events, 1, 50) > 0;
  };
  std::size_t sent = 0;
  do {
    robot.send(std::span(hello).subspan(sent++, 1));
  } while (!has_answer() && sent < hello.size());
  EXPECT_LT(sent, hello.size()) << "no answer to the " << sent << " bytes sent, 50 ms between two";
  expect_end(robot, ErrorCode::kTimeout, "no hello");
}

TEST_F(ConnectionTest, AFrameCutShortCostsTheConnectionOnly) {
  {
    auto robot = connect();
    ASSERT_TRUE(robot.hello("r1", "s1"));
    robot.send_frame(plain_frame(0));
    ASSERT_TRUE(robot.acked(1));
    robot.send(wire::encode_frame_head(plain_frame(1)));
    robot.close();
  }
  const auto again = connect();
  EXPECT_EQ(again.hello("r1", "s1"), (wire::Position{1, 0}));
  EXPECT_FALSE(std::filesystem::exists(image(1)));
}

TEST_F(ConnectionTest, AFrameWithAWrongChecksumIsNotTaken) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  auto frame = plain_frame(0);
  frame.jpeg_crc ^= 1;
  robot.send_frame(frame);
  expect_end(robot, ErrorCode::kMalformed, "checksum");
  EXPECT_FALSE(std::filesystem::exists(image(0)));
}

TEST_F(ConnectionTest, WhatAFrameSaysOfItsQualityIsKept) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send_frame(reduced_frame(0));
  ASSERT_TRUE(robot.acked(1));
  robot.send(wire::encode(wire::Bye{{1, 0}}));
  ASSERT_TRUE(robot.bye());
  EXPECT_THAT(test::read_file(folder_ / "r1/s1/quality.csv"), HasSubstr("\n0,30,40123,0A1B2C3D\n"));
}

TEST_F(ConnectionTest, AProtocolWeDoNotSpeakIsRefused) {
  const auto robot = connect();
  robot.send(wire::encode(wire::Hello{7, 8, "r1", "s1", "from the future", "", {}}));
  expect_end(robot, ErrorCode::kVersion, "the robot speaks protocol 7 to 8, we speak 6 to 6");
}

TEST_F(ConnectionTest, AProtocolOfBeforeTheFirstReleaseIsRefused) {
  const auto robot = connect();
  robot.send(wire::encode(wire::Hello{1, 5, "r1", "s1", "orbbufd 0.1.0", "", {}}));
  expect_end(robot, ErrorCode::kVersion, "the robot speaks protocol 1 to 5, we speak 6 to 6");
}

TEST_F(ConnectionTest, TheNewestVersionThatBothKnowIsTaken) {
  const auto robot = connect();
  robot.send(wire::encode(wire::Hello{4, 9, "r1", "s1", "from the future", "", {}}));
  EXPECT_TRUE(robot.welcome());
  robot.send_frame(plain_frame(0));
  EXPECT_EQ(robot.whole_ack(), (wire::Ack{{1, 0}, 1}));
}

TEST_F(ConnectionTest, AFrameIsReceivedBeforeItIsOnTheDevice) {
  settings_.sinks.files_sync = Durability::kAck;
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send_frame(plain_frame(0));
  EXPECT_EQ(robot.whole_ack(), (wire::Ack{{0, 0}, 1}));
  EXPECT_EQ(robot.whole_ack(), (wire::Ack{{1, 0}, 1}));
}

TEST_F(ConnectionTest, AFrameBeforeHelloIsUnexpected) {
  const auto robot = connect();
  robot.send_frame(plain_frame(0));
  expect_end(robot, ErrorCode::kUnexpected, "frame before hello");
}

TEST_F(ConnectionTest, AFrameBeforeHelloIsRefusedByItsHeader) {
  const auto robot = connect();
  const auto head = wire::encode_frame_head(plain_frame(0, 1'000'000));
  robot.send(std::span(head).first(wire::kHeaderBytes));
  expect_end(robot, ErrorCode::kUnexpected, "frame before hello");
}

TEST_F(ConnectionTest, AFrameFarBeyondThePositionIsRefused) {
  {
    const auto robot = connect();
    ASSERT_TRUE(robot.hello("r1", "s1"));
    robot.send_frame(plain_frame(std::numeric_limits<Sequence>::max() - 1));
    expect_end(robot, ErrorCode::kUnexpected, "cannot follow position 0");
  }
  const auto again = connect();
  EXPECT_EQ(again.hello("r1", "s1"), wire::Position{});
}

TEST_F(ConnectionTest, DropRecordsFarBeyondThePositionAreRefused) {
  {
    const auto robot = connect();
    ASSERT_TRUE(robot.hello("r1", "s1"));
    robot.send_drops(std::uint64_t{1} << 62, {{3, 0, DropReason::kPolicy}});
    expect_end(robot, ErrorCode::kUnexpected, "cannot follow position 0");
  }
  const auto again = connect();
  EXPECT_EQ(again.hello("r1", "s1"), wire::Position{});
}

TEST_F(ConnectionTest, DropRecordsOfFramesFarBeyondThePositionAreRefused) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send_drops(0, {{3, 0, DropReason::kPolicy},
                       {4, 0, DropReason::kBusy, kUnknownSimilarity, Sequence{1} << 62, 9}});
  expect_end(robot, ErrorCode::kUnexpected, "cannot follow position 0");
  EXPECT_FALSE(std::filesystem::exists(folder_ / "r1/s1/drops.csv"));
}

TEST_F(ConnectionTest, ItemsThatAreInPartKnownAreUnexpected) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  const DropRecord busy{3, 0, DropReason::kBusy};
  robot.send_drops(0, {busy, busy});
  EXPECT_EQ(robot.ack(), (wire::Position{0, 2}));
  robot.send_drops(1, {busy});  // a repeat
  EXPECT_EQ(robot.ack(), (wire::Position{0, 2}));
  robot.send_drops(1, {busy, busy});
  expect_end(robot, ErrorCode::kUnexpected, "items 1 to 2 of stream 1, of which 2 is the next");
}

TEST_F(ConnectionTest, ItemsOfAStreamThatTheServerDoesNotTakeAreUnexpected) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send(wire::encode(wire::Items{4, 0, {0, 1, 2}}));
  expect_end(robot, ErrorCode::kUnexpected, "items of stream 4, which this server does not take");
}

TEST_F(ConnectionTest, AccountsAreNumberedFromZeroInEachConnection) {
  wire::Account account;
  account.session_id = "s1";
  for (int i = 0; i < 2; ++i) {
    const auto robot = connect();
    ASSERT_TRUE(robot.hello("r1", "s1"));
    robot.send_account(0, account);
    robot.send_account(1, account);
    ASSERT_TRUE(robot.acked(2, wire::kAccounts));
    robot.send_account(1, account);
    expect_end(robot, ErrorCode::kUnexpected, "account 1, not 2");
  }
}

TEST_F(ConnectionTest, ALateFrameIsKeptBesideTheLiveOnesAndAcknowledged) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send_frame(plain_frame(1));
  robot.send_late(0, "s1", plain_frame(0, 2500));
  robot.send_late(1, "s1", plain_frame(0, 2500));
  ASSERT_TRUE(robot.acked(2, wire::kLate));
  EXPECT_EQ(test::read_file(image(0)), test::as_text(plain_frame(0, 2500).jpeg));
  robot.send_frame(plain_frame(2));
  ASSERT_TRUE(robot.acked(3));
  EXPECT_EQ(test::read_lines(folder_ / "r1/s1/times.txt").size(), 2U);
  robot.send(wire::encode(wire::Bye{{3, 0}}));
  ASSERT_TRUE(robot.bye());
  EXPECT_EQ(test::read_lines(folder_ / "r1/s1/times.txt").size(), 3U);
}

TEST_F(ConnectionTest, LiveFramesGoOnBetweenThePartsOfALateOne) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  const auto record = wire::encode_late_record("s1", plain_frame(0, 2500));
  const auto send_part = [&](std::size_t from, std::size_t to) {
    const wire::LatePart part{static_cast<std::uint32_t>(from),
                              static_cast<std::uint32_t>(record.size()),
                              std::span(record).subspan(from, to - from)};
    robot.send(wire::encode(wire::Items{wire::kLate, 0, wire::encode_late_part(part)}));
  };
  send_part(0, 1000);
  robot.send_frame(plain_frame(1));
  ASSERT_TRUE(robot.acked(2));
  send_part(1000, record.size());
  EXPECT_TRUE(robot.acked(1, wire::kLate));
}

TEST_F(ConnectionTest, AnEarlierSessionIsCompletedBesideThePresentOne) {
  {
    const auto robot = connect();
    ASSERT_TRUE(robot.hello("r1", "earlier"));
    robot.send_frame(plain_frame(2));
    ASSERT_TRUE(robot.acked(3));
  }
  server_.reset();
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  wire::Account account;
  account.session_id = "earlier";
  account.is_final = true;
  account.captured = 5;
  account.held = 1;
  robot.send_account(0, account);
  for (std::uint64_t i = 0; i < 20; ++i) robot.send_late(i, "earlier", plain_frame(0));
  ASSERT_TRUE(robot.acked(20, wire::kLate));
  account.held = 0;
  robot.send_account(1, account);
  ASSERT_TRUE(robot.acked(2, wire::kAccounts));
  EXPECT_EQ(test::read_lines(folder_ / "r1/earlier/times.txt").size(), 2U);
  EXPECT_THAT(test::read_file(folder_ / "r1/earlier/drops.csv"), HasSubstr("1,unknown,"));
}

TEST_F(ConnectionTest, AnEarlierSessionThatCannotBeOpenedDoesNotHoldTheLiveStream) {
  std::filesystem::create_directories(folder_ / "r1/broken/journal.000000");
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  name_session(robot, "broken", 1);
  robot.send_late(0, "broken", plain_frame(0));
  for (std::uint64_t i = 1; i <= 20; ++i) robot.send_late(i, "s1", plain_frame(100 + i));
  robot.send_frame(plain_frame(0));
  EXPECT_TRUE(robot.acked(1));
  EXPECT_FALSE(log_.lines("late frames paused").empty());
}

TEST_F(ConnectionTest, ManyLateFramesThatCannotBeWrittenDoNotHoldTheLiveStreamForLong) {
  std::filesystem::create_directories(folder_ / "r1/broken/journal.000000");
  {
    const auto robot = connect();
    ASSERT_TRUE(robot.hello("r1", "s1"));
    name_session(robot, "broken", 100);
    for (std::uint64_t i = 0; i < 30; ++i) robot.send_late(i, "broken", plain_frame(i));
    robot.send_frame(plain_frame(0));
    EXPECT_TRUE(robot.acked(1));
    robot.send_frame(plain_frame(1));
    EXPECT_TRUE(robot.acked(2));
    std::filesystem::remove(folder_ / "r1/broken/journal.000000");
    std::optional<wire::Ack> ack;
    do {
      ack = robot.whole_ack();
    } while (ack);  // what else comes is the end: all is to be sent again
  }
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  name_session(robot, "broken", 100);
  for (std::uint64_t i = 0; i < 30; ++i) robot.send_late(i, "broken", plain_frame(i));
  EXPECT_TRUE(robot.acked(30, wire::kLate));
}

TEST_F(ConnectionTest, ALateFrameOfASessionThatIsNotKnownIsUnexpected) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send_late(0, "another", plain_frame(0));
  expect_end(robot, ErrorCode::kUnexpected, "session another");
}

TEST_F(ConnectionTest, WithoutADiskLateFramesAreNotTaken) {
  settings_.sinks.files_enabled = false;
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send_late(0, "s1", plain_frame(0));
  expect_end(robot, ErrorCode::kUnexpected, "items of stream 2");
}

TEST_F(ConnectionTest, APayloadIsChecked) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send(wire::encode(wire::Items{wire::kDrops, 0, {0, 1, 2}}));
  expect_end(robot, ErrorCode::kMalformed, "drop records: 1 bytes are not 1 records");
}

TEST_F(ConnectionTest, AMessageForRobotsIsUnexpected) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send(wire::encode(wire::Ack{}));
  expect_end(robot, ErrorCode::kUnexpected, "unexpected ack");
}

TEST_F(ConnectionTest, ARobotsErrorIsLoggedAndEndsTheConnection) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  robot.send(wire::encode(wire::ErrorMessage{ErrorCode::kMalformed, "what was that?"}));
  EXPECT_TRUE(robot.is_closed());
  EXPECT_THAT(warning(), HasSubstr("the robot reports: what was that?"));
}

TEST_F(ConnectionTest, TheLastWordsArriveThoughTheRobotWentOnSending) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s1"));
  auto bad = plain_frame(0);
  bad.jpeg_crc ^= 1;
  robot.send_frame(bad);
  for (Sequence i = 1; i < 5; ++i) robot.send_frame(plain_frame(i, 200'000));
  expect_end(robot, ErrorCode::kMalformed, "checksum");
}

}  // namespace
}  // namespace orbbuf
