// SPDX-License-Identifier: Apache-2.0
// Who may connect, and how many: the part of server/listener.cpp that says no.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <thread>
#include <vector>

#include "tests/server/frames.hpp"
#include "tests/server/link/listener_fixture.hpp"

namespace orbbuf {
namespace {

using test::ListenerTest;
using test::plain_frame;
using test::RobotClient;
using wire::ErrorCode;

TEST_F(ListenerTest, ConnectionsBeyondTheLimitAreRefused) {
  settings_.listen.max_connections = 1;
  auto first = connect();
  ASSERT_TRUE(first.hello("r", "s"));
  const auto second = connect();
  const auto error = second.error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::kRefused);
  EXPECT_EQ(error->text, "all 1 connections are taken");
  first.send(wire::encode(wire::Bye{}));
  EXPECT_TRUE(first.bye());
  EXPECT_TRUE(first.is_closed());
  first.close();
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (!connect().hello("r", "s")) {  // the server may see the end of the first one later
    ASSERT_LT(std::chrono::steady_clock::now(), deadline) << "no place has become free";
  }
}

TEST_F(ListenerTest, OneAddressDoesNotTakeAllConnections) {
  settings_.listen.max_connections_per_address = 2;
  const auto first = connect();
  ASSERT_TRUE(first.hello("r1", "s"));
  const auto second = connect();
  ASSERT_TRUE(second.hello("r2", "s"));
  const auto error = connect().error();
  ASSERT_TRUE(error);
  EXPECT_EQ(error->text, "127.0.0.1 has all its 2 connections");
}

/// C5
TEST_F(ListenerTest, ConnectionsWithoutAHelloLeaveTheirPlacesToRobots) {
  settings_.listen.max_connections_per_address = 2;
  const auto robot = connect();
  ASSERT_TRUE(robot.hello("r1", "s"));
  const auto silent = connect();
  const auto half = connect();
  half.send_text("ORB");
  EXPECT_TRUE(silent.is_closed());
  const auto other = connect();
  EXPECT_TRUE(half.is_closed());
  EXPECT_TRUE(other.hello("r2", "s"));
  robot.send_frame(plain_frame(0));
  EXPECT_TRUE(robot.acked(1));
  EXPECT_EQ(log_.lines("too many connections: 127.0.0.1 has all its 2 connections").size(), 1U);
}

TEST_F(ListenerTest, ARobotThatWaitsForTheDiskIsNoStranger) {
  settings_.listen.max_connections_per_address = 2;
  make_unreadable("r/s");
  const auto robot = connect();
  robot.send_hello("r", "s");
  while (!server_->has_session("r", "s")) std::this_thread::yield();
  const auto silent = connect();
  const auto another = connect();
  EXPECT_TRUE(silent.is_closed());
  finish_reading("r/s");
  EXPECT_EQ(robot.welcome(), (wire::Position{1, 0}));
}

/// From an address of its own.
RobotClient connect_from(const char* address, std::uint16_t port) {
  UniqueFd socket = RobotClient::tcp_socket();
  sockaddr_in own{};
  own.sin_family = AF_INET;
  ::inet_pton(AF_INET, address, &own.sin_addr);
  EXPECT_EQ(::bind(socket.get(), reinterpret_cast<const sockaddr*>(&own), sizeof(own)), 0);
  return RobotClient(port, std::move(socket));
}

TEST_F(ListenerTest, TheAddressWithTheMostSilentConnectionsLosesThem) {
  settings_.listen.max_connections = 3 * 4;  // three may be silent
  start();
  const auto alone = connect_from("127.0.0.2", server_->port());
  const auto first = connect_from("127.0.0.3", server_->port());
  const auto second = connect_from("127.0.0.3", server_->port());
  const auto third = connect_from("127.0.0.4", server_->port());
  EXPECT_TRUE(first.is_closed());
  EXPECT_TRUE(alone.hello("r", "s"));
  EXPECT_TRUE(second.hello("r2", "s"));
  EXPECT_TRUE(third.hello("r3", "s"));
}

TEST_F(ListenerTest, RobotsBeyondTheLimitAreRefused) {
  settings_.listen.max_robots = 1;
  const auto first = connect();
  ASSERT_TRUE(first.hello("r1", "s"));
  const auto second = connect();
  EXPECT_FALSE(second.hello("r2", "s"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "data/r2"));
  const auto first_again = connect();
  EXPECT_TRUE(first_again.hello("r1", "s2")) << "its old session must not count";
  server_->stop();
  EXPECT_EQ(log_.lines("all 1 robots' places are taken").size(), 1U);
}

TEST_F(ListenerTest, OnlyRobotsOnTheListAreServed) {
  settings_.listen.robots = {"r1"};
  EXPECT_TRUE(connect().hello("r1", "s"));
  EXPECT_FALSE(connect().hello("r2", "s"));
  EXPECT_FALSE(connect().hello("r2", "s"));
  EXPECT_FALSE(std::filesystem::exists(folder_ / "data/r2"));
  server_->stop();
  EXPECT_EQ(log_.lines("r2 is not among listen.robots").size(), 1U)
      << "once, however often it asks";
}

TEST_F(ListenerTest, TwoRobotsOfOneNameDoNotReplaceEachOtherForEver) {
  const auto first = connect();
  ASSERT_TRUE(first.hello("r", "a"));
  const auto second = connect();
  ASSERT_TRUE(second.hello("r", "b"));
  EXPECT_FALSE(connect().hello("r", "a"));
  second.send_frame(plain_frame(0));
  EXPECT_TRUE(second.acked(1));
  server_->stop();
  EXPECT_EQ(log_.lines("r has begun another session since a; are there two").size(), 1U);
}

/// A robot at line rate, an hour's frames in its hands; and one with a frame now and then.
TEST_F(ListenerTest, ARobotAtLineRateDoesNotStarveAnother) {
  const auto greedy = connect();
  ASSERT_TRUE(greedy.hello("greedy", "s"));
  const auto modest = connect();
  ASSERT_TRUE(modest.hello("modest", "s"));
  std::jthread acks([&] {
    while (greedy.ack()) {
    }
  });
  std::atomic<Sequence> sent = 0;
  std::jthread flood([&](const std::stop_token& stop) {
    while (!stop.stop_requested()) greedy.send_frame(plain_frame(sent++, 40'000));
  });
  constexpr Sequence kModest = 50;
  std::vector<Sequence> meanwhile;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  for (Sequence i = 0; i < kModest || frames_kept("greedy/s") <= kModest; ++i) {
    ASSERT_LT(std::chrono::steady_clock::now(), deadline)
        << i << " frames of modest kept, and " << frames_kept("greedy/s") << " of greedy";
    const Sequence before = sent;
    modest.send_frame(plain_frame(i, 40'000));
    ASSERT_TRUE(modest.acked(i + 1));
    meanwhile.push_back(sent - before);
  }
  flood.request_stop();
  flood.join();
  server_->stop();
  EXPECT_GT(frames_kept("greedy/s"), kModest) << "there was no flood";
  // What the kernel's two buffers take in at once is no turn of the server's.
  std::ranges::sort(meanwhile);
  EXPECT_LT(meanwhile[meanwhile.size() / 2], 60U) << "of the other's frames for one of ours";
}

}  // namespace
}  // namespace orbbuf
