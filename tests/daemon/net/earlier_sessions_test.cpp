// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/earlier_sessions.hpp"

#include <gtest/gtest.h>

#include <boost/asio/post.hpp>
#include <thread>

#include "daemon/buffer/simple_policies.hpp"
#include "daemon/net/sender.hpp"
#include "testing/captured_log.hpp"
#include "testing/scripted_server.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using wire::Type;

constexpr std::int64_t kLastCaptureNs = 9000;

/// A robot whose folder has the records of earlier processes, against a server that the test plays.
class EarlierSessionsTest : public ::testing::Test {
 protected:
  /// A process that captured 10 frames and dropped frame 7; the server confirmed all below `next`.
  void leave_session(const std::string& id, Sequence next = 5, const std::string& robot = "r") {
    SessionLog log(folder_.path(), robot, id);
    log.add(std::vector<DropRecord>{{7, 7000, DropReason::kPolicy}});
    log.note(10, kLastCaptureNs, {next, 0});
  }
  void leave_ended_session(const std::string& id) {
    SessionLog log(folder_.path(), "r", id);
    log.add(std::vector<DropRecord>{{7, 7000, DropReason::kUnknown},
                                    {8, 8000, DropReason::kUnknown},
                                    {9, 9000, DropReason::kShutdown}});
    log.note(10, kLastCaptureNs, {7, 0});
    log.end(false);
  }
  void start() {
    link_.servers.front().port = server_.port();
    wire::Hello hello;
    hello.robot_id = "r";
    hello.session_id = "new";
    hello.calibration = "camera";
    sender_ = std::make_unique<Sender>(io_, link_, hello, buffer_, drops_, log_);
    sender_->start(find_earlier_sessions(folder_.path()));
    main_ = std::jthread([this] { io_.run(); });
  }
  wire::Dropped dropped() {
    const test::Message message = server_.read(Type::kDropped);
    return wire::parse_dropped(message.header, message.body).value();
  }
  void TearDown() override {
    asio::post(io_, [this] { io_.stop(); });
    if (main_.joinable()) main_.join();
  }

  LinkSettings link_;
  test::ScriptedServer server_;
  test::TemporaryFolder folder_;
  FrameBuffer buffer_{{5}, std::make_unique<DropOldestPolicy>()};
  DropLog drops_;
  SessionLog log_{{}, "r", "new"};
  asio::io_context io_;
  std::unique_ptr<Sender> sender_;
  std::jthread main_;
};

TEST_F(EarlierSessionsTest, ServerGetsTheRestOfTheRecordBeforeTheNewSessionBegins) {
  leave_session("old");
  start();
  const wire::Hello hello = server_.welcome({6, 0});  // frame 5 came, its ack was lost
  EXPECT_EQ(hello.session_id, "old");
  EXPECT_EQ(hello.calibration, "");
  const wire::Dropped all = dropped();
  EXPECT_EQ(all.first_drop, 0U);
  EXPECT_EQ(all.records, (std::vector<DropRecord>{{7, 7000, DropReason::kPolicy},
                                                  {6, kLastCaptureNs, DropReason::kUnknown},
                                                  {8, kLastCaptureNs, DropReason::kUnknown},
                                                  {9, kLastCaptureNs, DropReason::kUnknown}}));
  server_.ack({6, 4});
  EXPECT_EQ(server_.welcome({}).session_id, "new");
  EXPECT_TRUE(find_earlier_sessions(folder_.path()).empty());
}

TEST_F(EarlierSessionsTest, FramesThatTheServerHasLostAreNamedAsLost) {
  leave_session("old", 8);
  start();
  server_.welcome({6, 1});
  const wire::Dropped rest = dropped();
  EXPECT_EQ(rest.first_drop, 1U);
  EXPECT_EQ(rest.records, (std::vector<DropRecord>{{6, kLastCaptureNs, DropReason::kLost},
                                                   {8, kLastCaptureNs, DropReason::kUnknown},
                                                   {9, kLastCaptureNs, DropReason::kUnknown}}));
  server_.close();
  server_.welcome({6, 2});
  EXPECT_EQ(dropped().first_drop, 2U);
}

TEST_F(EarlierSessionsTest, ASessionThatEndedInAnOrderlyWayIsEndedAtTheServer) {
  leave_ended_session("old");
  start();
  server_.welcome({8, 0});
  EXPECT_EQ(dropped().records,
            (std::vector<DropRecord>{{8, 8000, DropReason::kUnknown},
                                     {9, 9000, DropReason::kShutdown}}));  // it has frame 7
  server_.ack({8, 2});
  const test::Message message = server_.read(Type::kBye);
  EXPECT_EQ(wire::parse_bye(message.header, message.body).value().position,
            (wire::Position{10, 2}));
  server_.send(wire::encode(wire::Bye{{8, 2}}));
  EXPECT_EQ(server_.welcome({}).session_id, "new");
}

TEST_F(EarlierSessionsTest, ASessionOfWhichNothingIsMissingIsNotToldAgain) {
  {
    SessionLog log(folder_.path(), "r", "whole");
    log.note(10, kLastCaptureNs, {10, 0});
  }
  {
    SessionLog log(folder_.path(), "r", "without-bye");
    log.note(10, kLastCaptureNs, {10, 0});
    log.end(false);
  }
  start();
  EXPECT_EQ(server_.welcome({10, 0}).session_id, "without-bye");
  server_.read(Type::kBye);
  server_.send(wire::encode(wire::Bye{{10, 0}}));
  EXPECT_EQ(server_.welcome({}).session_id, "new");
  EXPECT_TRUE(find_earlier_sessions(folder_.path()).empty());
}

TEST_F(EarlierSessionsTest, SessionsAreToldOneAfterTheOtherAndOnlyThoseOfThisRobot) {
  leave_session("a");
  leave_session("b", 5, "another");
  leave_session("c");
  start();
  EXPECT_EQ(server_.welcome({5, 0}).session_id, "a");
  server_.ack({5, 5});
  EXPECT_EQ(server_.welcome({5, 5}).session_id, "c");
  EXPECT_EQ(server_.welcome({}).session_id, "new");
}

TEST_F(EarlierSessionsTest, WhatTheServerRefusesWaitsForTheNextStart) {
  test::CapturedLog log;
  leave_session("old");
  start();
  server_.accept();
  server_.read(Type::kHello);
  server_.send(wire::encode(wire::ErrorMessage{wire::ErrorCode::kRefused, "no"}));
  EXPECT_EQ(server_.welcome({}).session_id, "new");
  EXPECT_EQ(find_earlier_sessions(folder_.path()).size(), 1U);
  log.wait_for("session old: the server's record stays incomplete: the server refuses it");
}

TEST_F(EarlierSessionsTest, ASessionThatTheServerHasNoMoreIsNotBegunAgain) {
  leave_session("old");
  start();
  server_.welcome({});
  EXPECT_EQ(server_.welcome({}).session_id, "new");
  EXPECT_TRUE(find_earlier_sessions(folder_.path()).empty());
}

TEST_F(EarlierSessionsTest, FramesWaitUntilTheirOwnSessionIsWelcome) {
  leave_session("old");
  auto frame = std::make_shared<EncodedFrame>();
  frame->jpeg.assign(100, 0);
  frame->jpeg_crc = wire::crc32(frame->jpeg);
  buffer_.on_captured();
  buffer_.push(std::move(frame));
  start();
  server_.welcome({5, 0});
  asio::post(io_, [this] { sender_->wake(); });
  EXPECT_EQ(server_.read()->type(), Type::kDropped);
  server_.ack({5, 5});
  server_.welcome({});
  EXPECT_EQ(server_.read(Type::kFrame).frame().sequence, 0U);
}

}  // namespace
}  // namespace orbbuf
