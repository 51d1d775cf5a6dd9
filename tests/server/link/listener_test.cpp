// SPDX-License-Identifier: Apache-2.0
#include "server/link/listener.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include <memory>
#include <optional>
#include <stdexcept>
#include <utility>

#include "tests/server/frames.hpp"
#include "tests/server/link/listener_fixture.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf {
namespace {

using test::jpeg_like_frame_ptr;
using test::ListenerTest;
using test::plain_frame;
using test::RobotClient;
using wire::ErrorCode;

TEST_F(ListenerTest, TellsWhereItListens) {
  start();
  server_->stop();
  EXPECT_EQ(log_.lines("info listening on 127.0.0.1:" + std::to_string(server_->port())).size(),
            1U);
}

TEST_F(ListenerTest, APortThatIsTakenIsToldAtTheStart) {
  start();
  settings_.listen.address.port = server_->port();
  boost::asio::io_context main;
  boost::asio::thread_pool files(1);
  try {
    const Listener second(main, files, settings_);
    FAIL() << "listens on a port that is taken";
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(error.what(),
              "listen on " + to_string(settings_.listen.address) + ": Address already in use");
  }
}

TEST_F(ListenerTest, ARobotWhoseFramesTheDiskDoesNotTakeIsSentAway) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  const test::ResourceLimit full(RLIMIT_FSIZE, 1000);
  robot.send_frame(plain_frame(0, 5000));
  const auto error = robot.error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kSentAway);
  EXPECT_THAT(error->text, testing::StartsWith("this server cannot keep frames: "));
  EXPECT_TRUE(server_->has_session("r", "s"));  // for a robot that has no other server
}

TEST_F(ListenerTest, AServerThatDrainsTakesNoRobotAndTellsThoseItHasWhatItKeeps) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  robot.send_frame(plain_frame(0));
  EXPECT_EQ(robot.ack(), (wire::Position{1, 0}));
  server_->drain();
  EXPECT_EQ(robot.bye(), (wire::Position{1, 0}));
  EXPECT_THROW(RobotClient(server_->port()), std::exception);
  server_->drain();  // once more
}

TEST_F(ListenerTest, TwoRobotsAreServedAtOnce) {
  const auto a = connect();
  const auto b = connect();
  ASSERT_TRUE(a.hello("a", "s"));
  ASSERT_TRUE(b.hello("b", "s"));
  for (Sequence i = 0; i < 50; ++i) {
    a.send_frame(plain_frame(i, 20'000));
    b.send_frame(plain_frame(i, 10'000));
  }
  EXPECT_TRUE(b.acked(50));
  EXPECT_TRUE(a.acked(50));
  EXPECT_EQ(frames_kept("a/s"), 50U);
  EXPECT_EQ(frames_kept("b/s"), 50U);
}

TEST_F(ListenerTest, ARobotThatConnectsAgainGoesOnWhereItWas) {
  const auto first = connect();
  ASSERT_TRUE(first.hello("r", "s"));
  first.send_frame(plain_frame(0));
  ASSERT_TRUE(first.acked(1));
  first.send(wire::encode_frame_head(plain_frame(1, 1000)));  // and stalls
  const auto second = connect();
  EXPECT_EQ(second.hello("r", "s"), (wire::Position{1, 0}));
  const auto error = first.error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kReplaced);
  second.send_frame(plain_frame(1, 1000));
  EXPECT_TRUE(second.acked(2));
  EXPECT_EQ(frames_kept("r/s"), 2U);
}

TEST_F(ListenerTest, ASessionIsOpenedWhileOtherRobotsAreServed) {
  make_unreadable("slow/s");
  const auto slow = connect();
  slow.send_hello("slow", "s");
  const auto other = connect();
  ASSERT_TRUE(other.hello("other", "s"));
  other.send_frame(plain_frame(0));
  EXPECT_TRUE(other.acked(1));
  EXPECT_TRUE(server_->has_session("slow", "s"));
  EXPECT_FALSE(has_answer(slow, 0));
  finish_reading("slow/s");
  EXPECT_EQ(slow.welcome(), (wire::Position{1, 0}));
  slow.send_frame(plain_frame(1));
  EXPECT_TRUE(slow.acked(2));
}

TEST_F(ListenerTest, TheNewestConnectionGetsTheSessionThatWasBeingOpened) {
  make_unreadable("r/s");
  const auto first = connect();
  first.send_hello("r", "s");
  const auto second = connect();
  second.send_hello("r", "s");
  const auto error = first.error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kReplaced);
  finish_reading("r/s");
  EXPECT_EQ(second.welcome(), (wire::Position{1, 0}));
}

TEST_F(ListenerTest, ANewSessionEndsTheOneThatWasBeingOpened) {
  make_unreadable("r/before");
  const auto first = connect();
  first.send_hello("r", "before");
  const auto second = connect();
  second.send_hello("r", "after");
  const auto error = first.error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kReplaced);
  finish_reading("r/before");
  EXPECT_EQ(second.welcome(), wire::Position{});
  const auto late = connect();
  EXPECT_FALSE(late.hello("r", "before"));
  second.send_frame(plain_frame(0));
  EXPECT_TRUE(second.acked(1));
}

TEST_F(ListenerTest, StopsOnceASessionHasBeenOpened) {
  make_unreadable("r/s");
  const auto robot = connect();
  robot.send_hello("r", "s");
  const auto other = connect();
  ASSERT_TRUE(other.hello("other", "s"));  // so the first hello was read
  std::thread stopper([this] { server_->stop(); });
  const auto error = robot.error();
  finish_reading("r/s");
  stopper.join();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->text, "the server stops");
}

TEST_F(ListenerTest, ARebootedRobotsOldSessionIsClosed) {
  const auto first = connect();
  ASSERT_TRUE(first.hello("r", "before"));
  const auto other = connect();
  ASSERT_TRUE(other.hello("r2", "before"));
  const auto second = connect();
  EXPECT_EQ(second.hello("r", "after"), wire::Position{});
  const auto error = first.error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kReplaced);
  other.send_frame(plain_frame(0));
  EXPECT_TRUE(other.acked(1));
  server_->stop();
  EXPECT_EQ(log_.lines("r before: session closed, the robot has begun another").size(), 1U);
}

TEST_F(ListenerTest, ASessionIsOpenUntilItsRobotCannotComeBackToIt) {
  auto robot = connect();
  EXPECT_FALSE(server_->has_session("r", "s"));
  ASSERT_TRUE(robot.hello("r", "s"));
  EXPECT_TRUE(server_->has_session("r", "s"));
  EXPECT_FALSE(server_->has_session("r", "other"));
  robot.close();
  const auto again = connect();
  EXPECT_TRUE(server_->has_session("r", "s"));
  ASSERT_TRUE(again.hello("r", "s"));
  again.send(wire::encode(wire::Bye{}));
  ASSERT_TRUE(again.bye());
  EXPECT_FALSE(server_->has_session("r", "s"));
}

TEST_F(ListenerTest, ASessionGoesOnAfterARestartOfTheServer) {
  {
    const auto robot = connect();
    ASSERT_TRUE(robot.hello("r", "s"));
    robot.send_frame(plain_frame(3));
    ASSERT_TRUE(robot.acked(4));
    robot.send_drops(0, {{2, 0, DropReason::kPolicy}});
    ASSERT_TRUE(robot.acked(1, wire::kDrops));
  }
  start();
  EXPECT_EQ(connect().hello("r", "s"), (wire::Position{4, 1}));
}

TEST_F(ListenerTest, ARecordThatCannotBeReadRefusesThatSessionOnly) {
  std::filesystem::create_directories(folder_ / "data/r/s/journal.000000");
  const auto robot = connect();
  EXPECT_FALSE(robot.hello("r", "s"));
  EXPECT_TRUE(connect().hello("r", "s2"));
  server_->stop();
  EXPECT_EQ(log_.lines("error r s: no session: ").size(), 1U);
}

TEST_F(ListenerTest, RunningOutOfDescriptorsIsSurvived) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  // All threads run by then: without descriptors UBSan cannot look at what a new one brings.
  robot.send_frame(plain_frame(0));
  ASSERT_TRUE(robot.acked(1));
  UniqueFd socket = RobotClient::tcp_socket();
  std::unique_ptr<RobotClient> late;
  {
    const test::ResourceLimit no_more(RLIMIT_NOFILE, 1);  // those that are open stay so
    late = std::make_unique<RobotClient>(server_->port(), std::move(socket));
    late->send(wire::encode(wire::Hello{6, 6, "late", "s", "", "", {}}));
    log_.wait_for("error accept on ");
    EXPECT_FALSE(has_answer(*late, 500));  // longer than two tries
  }
  EXPECT_TRUE(late->welcome());
  robot.send_frame(plain_frame(1));
  EXPECT_TRUE(robot.acked(2));
  server_->stop();
  EXPECT_EQ(log_.lines("error accept on ").size(), 1U);
  EXPECT_EQ(log_.lines("accepting connections again").size(), 1U);
}

TEST_F(ListenerTest, AFullDiskHoldsTheStreamUntilThereIsRoom) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  robot.send_frame(plain_frame(0, 100));
  ASSERT_TRUE(robot.acked(1));
  const auto again = connect();
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, 1000);
    robot.send_frame(plain_frame(1, 5000));
    robot.send_frame(plain_frame(2, 100));
    log_.wait_for("stream paused");
    const auto error = robot.error();
    ASSERT_TRUE(error);
    EXPECT_EQ(error->code, ErrorCode::kSentAway);
    ASSERT_EQ(again.hello("r", "s"), (wire::Position{1, 0}));  // it has no other server
    again.send_frame(plain_frame(1, 5000));
    again.send_frame(plain_frame(2, 100));
    // The server tells the robot what it may forget, and that it lives.
    const auto ack = again.whole_ack();
    ASSERT_TRUE(ack);
    EXPECT_EQ(ack->position, (wire::Position{1, 0}));
    EXPECT_NE(ack->pause.find("File too large"), std::string::npos) << ack->pause;
  }
  EXPECT_TRUE(again.acked(3));
  server_->stop();
  EXPECT_EQ(log_.lines("error r s: stream paused: write ").size(), 1U);
  EXPECT_EQ(frames_kept("r/s"), 3U);
}

TEST_F(ListenerTest, APipeWithoutAReaderHoldsItsOwnRobotOnly) {
  settings_.sinks.files_enabled = false;
  settings_.sinks.slam.fifo = folder_ / "{robot}.fifo";
  settings_.sinks.slam.format = PipeFormat::kMjpeg;
  const auto held = connect();
  ASSERT_TRUE(held.hello("held", "s"));
  ASSERT_EQ(::mkfifo((folder_ / "read.fifo").c_str(), 0600), 0);
  const UniqueFd reader(::open((folder_ / "read.fifo").c_str(), O_RDONLY | O_NONBLOCK));
  const auto read = connect();
  ASSERT_TRUE(read.hello("read", "s"));
  held.send_frame(*jpeg_like_frame_ptr(0));
  read.send_frame(*jpeg_like_frame_ptr(0));
  EXPECT_TRUE(read.acked(1));
  EXPECT_EQ(held.ack(), wire::Position{});
  // The robot comes back; what nobody read is still its own.
  const auto again = connect();
  EXPECT_EQ(again.hello("held", "s"), wire::Position{});
}

TEST_F(ListenerTest, WhoHasSaidByeIsNotIdleWhileAReaderIsWaitedFor) {
  settings_.listen.idle_timeout = std::chrono::seconds(2);
  settings_.drain_timeout = std::chrono::seconds(3);
  settings_.sinks.slam.fifo = folder_ / "{robot}.fifo";
  settings_.sinks.slam.format = PipeFormat::kMjpeg;
  settings_.sinks.slam.resume = Resume::kBacklog;
  ASSERT_EQ(::mkfifo((folder_ / "r.fifo").c_str(), 0600), 0);
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  robot.send_frame(*jpeg_like_frame_ptr(0, 300'000));  // more than the FIFO holds
  ASSERT_TRUE(robot.acked(1));
  const UniqueFd reader(::open((folder_ / "r.fifo").c_str(), O_RDONLY | O_NONBLOCK));
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (log_.lines("has a reader").empty()) {
    ASSERT_LT(std::chrono::steady_clock::now(), deadline) << "no reader in the log";
    robot.send(wire::encode(wire::Report{}));
    ::poll(nullptr, 0, 100);  // the server looks for a reader each second
  }
  robot.send(wire::encode(wire::Bye{{1, 0}}));
  const auto again = connect();
  again.send_hello("r", "s");
  const auto error = again.error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->text, "the session is being closed");
  EXPECT_EQ(robot.bye(), (wire::Position{1, 0}));
}

TEST_F(ListenerTest, RobotsThatAreNotAllowedAnyMoreAreCutOffAndOthersAreNot) {
  const auto kept = connect();
  ASSERT_TRUE(kept.hello("kept", "s"));
  const auto excluded = connect();
  ASSERT_TRUE(excluded.hello("excluded", "s"));
  const auto silent = connect();
  server_->allow({"kept"});
  const auto error = excluded.error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->text, "excluded is not among listen.robots any more");
  EXPECT_TRUE(excluded.is_closed());
  kept.send_frame(plain_frame(0));
  EXPECT_TRUE(kept.acked(1));
  EXPECT_TRUE(silent.hello("kept", "s"));
  EXPECT_FALSE(connect().hello("excluded", "s"));
  server_->allow({});
  EXPECT_TRUE(connect().hello("excluded", "s"));
}

TEST_F(ListenerTest, ASessionWithoutAConnectionIsClosedInTheEnd) {
  settings_.session_timeout = std::chrono::milliseconds(20);
  settings_.sinks.slam.fifo = folder_ / "{robot}.fifo";
  ASSERT_EQ(::mkfifo((folder_ / "r.fifo").c_str(), 0600), 0);
  const UniqueFd reader(::open((folder_ / "r.fifo").c_str(), O_RDONLY | O_NONBLOCK));
  auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  robot.close();
  pollfd end{reader.get(), POLLIN, 0};  // POLLHUP: the writer has gone
  EXPECT_EQ(::poll(&end, 1, 30'000), 1);
  EXPECT_EQ(end.revents, POLLHUP);
  EXPECT_TRUE(connect().hello("r", "s"));
}

TEST_F(ListenerTest, StoppingSaysByeToEverybody) {
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r", "s"));
  robot.send_frame(plain_frame(0));
  ASSERT_TRUE(robot.acked(1));
  const auto silent = connect();
  const auto also = connect();
  ASSERT_TRUE(also.hello("r2", "s"));
  std::thread stopper([this] { server_->stop(); });
  EXPECT_EQ(robot.bye(), (wire::Position{1, 0}));
  EXPECT_EQ(also.bye(), wire::Position{});
  const auto error = silent.error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->text, "the server stops");
  stopper.join();
}

}  // namespace
}  // namespace orbbuf
