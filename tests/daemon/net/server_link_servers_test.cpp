// SPDX-License-Identifier: Apache-2.0
// A link that several servers may take.
#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <thread>

#include "testing/captured_log.hpp"
#include "testing/own_network.hpp"
#include "testing/process.hpp"
#include "tests/daemon/net/link_rig.hpp"

namespace orbbuf {
namespace {

using test::address_of;
using test::LinkRig;
using test::ScriptedServer;
using wire::ErrorCode;

class TwoServersRig : protected LinkRig {
 protected:
  ~TwoServersRig() { stop(); }  // before the log and the other server
  /// Attempts that nothing but the next interval would begin do not come within the test.
  void only_at_once() { settings_.attempt_interval = std::chrono::hours(1); }
  void start_with_both() { start({address_of(a_), address_of(b_)}); }
  void start_on_a() {
    start_with_both();
    a_.welcome({});
    expect_connected();
  }
  void start_on_a_with_heartbeat() {
    start_with_both();
    welcome_with_heartbeat();
  }
  void welcome_with_heartbeat() {
    a_.accept_hello();
    wire::Welcome welcome;
    welcome.takes.set(wire::kFrames).set(wire::kDrops);
    welcome.has_heartbeat = true;
    a_.send(wire::encode(welcome));
    expect_connected();
  }
  void expect_connected_to(const ScriptedServer& server) {
    expect_connected();
    EXPECT_EQ(ask([](const ServerLink& link) { return link.server(); }), address_of(server));
  }
  static void say(ScriptedServer& server, ErrorCode code, const std::string& text) {
    server.send(wire::encode(wire::ErrorMessage{code, text}));
  }
  static FramePtr one_frame() {
    EncodedFrame frame;
    frame.jpeg = {0xFF, 0xD8, 0xFF, 0xD9};
    frame.left_bytes = 4;
    frame.jpeg_crc = wire::crc32(frame.jpeg);
    frame.width_px = frame.height_px = 1;
    return std::make_shared<const EncodedFrame>(std::move(frame));
  }
  const test::CapturedLog log_;
  ScriptedServer& a_ = server_;
  ScriptedServer b_;
};

class ServerLinkServers : public ::testing::Test, protected TwoServersRig {};

TEST_F(ServerLinkServers, TheFirstIsTriedFirst) {
  only_at_once();
  start_with_both();
  a_.welcome({});
  expect_connected_to(a_);
}

TEST_F(ServerLinkServers, TheNextIsTriedWhenTheFirstIsDead) {
  const Address dead = address_of(a_);
  a_.die();
  start({dead, address_of(b_)});
  b_.welcome({});
  expect_connected_to(b_);
  EXPECT_EQ(log_.lines("no connection to " + to_string(dead) + ": cannot connect").size(), 1U);
  EXPECT_EQ(log_.lines("connected to " + to_string(address_of(b_))).size(), 1U);
}

TEST_F(ServerLinkServers, OneThatRefusesDoesNotKeepTheRobotFromTheOther) {
  only_at_once();
  start_with_both();
  a_.accept_hello();
  say(a_, ErrorCode::kRefused, "full");
  b_.welcome({});
  expect_connected_to(b_);
}

TEST_F(ServerLinkServers, OneThatRefusesInTheMiddleOfASessionDoesNotEither) {
  start_on_a();
  say(a_, ErrorCode::kRefused, "no longer");
  EXPECT_EQ(owner_.next(), "disconnected 0 0");
  b_.welcome({});
  expect_connected_to(b_);
}

TEST_F(ServerLinkServers, OneThatAnswersAndNeverWelcomesIsLeft) {
  settings_.connect_timeout = std::chrono::milliseconds(500);
  start_on_a();
  a_.close();  // its kernel takes connections
  EXPECT_EQ(owner_.next(), "disconnected 0 0");
  b_.welcome({});
  expect_connected_to(b_);
}

TEST_F(ServerLinkServers, AKilledServerIsReplacedByAnotherWhichIsKept) {
  start_on_a();
  a_.die();
  EXPECT_EQ(owner_.next(), "disconnected 0 0");
  b_.welcome({7, 3});
  EXPECT_EQ(owner_.next(), "connected 7 3");
  EXPECT_EQ(owner_.next(), "writable 0 0");
  b_.close();
  EXPECT_EQ(owner_.next(), "disconnected 0 0");
  b_.welcome({});
  expect_connected_to(b_);
}

TEST_F(ServerLinkServers, ABrokenConnectionIsMadeAnewToTheSameServer) {
  start_on_a();
  for (int i = 0; i < 5; ++i) {
    a_.close();
    EXPECT_EQ(owner_.next(), "disconnected 0 0");
    a_.welcome({});
    expect_connected_to(a_);
  }
  EXPECT_EQ(log_.lines("connected to " + to_string(address_of(b_))).size(), 0U);
}

TEST_F(ServerLinkServers, ANameThatHasNoAddressIsLoggedBesideAConnection) {
  start({address_of(a_), {"no-such-host.invalid", 7722}});
  a_.welcome({});
  expect_connected();
  log_.wait_for("cannot resolve no-such-host.invalid: ");
}

TEST_F(ServerLinkServers, OneThatSendsTheRobotAwayIsLeftForTheOther) {
  start_on_a();
  say(a_, ErrorCode::kSentAway, "the disk is full");
  EXPECT_EQ(owner_.next(), "disconnected 0 0");
  b_.welcome({});
  expect_connected_to(b_);
}

TEST_F(ServerLinkServers, TheOnlyOneIsTriedAgainAtOnce) {
  settings_.attempt_interval = std::chrono::milliseconds(10);
  start({address_of(a_)});
  const auto begin = std::chrono::steady_clock::now();
  for (int i = 0; i < 8; ++i) {  // as refusals, 2.5 s
    a_.welcome({});
    expect_connected();
    say(a_, ErrorCode::kSentAway, "the disk is full");
    EXPECT_EQ(owner_.next(), "disconnected 0 0");
  }
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(2));
}

TEST_F(ServerLinkServers, AServerIsNotLeftForAPauseOfTheRobot) {
  start_on_a_with_heartbeat();
  ask([](ServerLink& link) { return link.write(one_frame()), true; });
  EXPECT_EQ(a_.read(wire::Type::kFrame).frame().sequence, 0U);
  EXPECT_EQ(owner_.next(), "writable 0 0");
  ask([](ServerLink&) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1500));
    return true;
  });
  a_.ack({1, 0});  // 300 ms later it would be too late
  EXPECT_EQ(owner_.next(), "ack 1 0");
  EXPECT_TRUE(ask([](const ServerLink& link) { return link.is_connected(); }));
}

TEST_F(ServerLinkServers, AServerThatStandsStillIsLeftForAnother) {
  start_on_a_with_heartbeat();
  ask([](ServerLink& link) { return link.write(one_frame()), true; });
  EXPECT_EQ(a_.read(wire::Type::kFrame).frame().sequence, 0U);  // and it says nothing of it
  EXPECT_EQ(owner_.next(), "writable 0 0");
  EXPECT_EQ(owner_.next(), "disconnected 0 0");
  b_.welcome({});
  expect_connected_to(b_);
  EXPECT_EQ(log_.lines("has acknowledged nothing for 1.").size(), 1U);
}

TEST_F(ServerLinkServers, TheOnlyOneThatStandsStillIsLeftForAnotherConnection) {
  start({address_of(a_)});
  welcome_with_heartbeat();
  ask([](ServerLink& link) { return link.write(one_frame()), true; });
  EXPECT_EQ(a_.read(wire::Type::kFrame).frame().sequence, 0U);
  EXPECT_EQ(owner_.next(), "writable 0 0");
  EXPECT_EQ(owner_.next(), "disconnected 0 0");
  log_.wait_for("has acknowledged nothing for 1.");  // after the owner is told
  EXPECT_EQ(log_.lines("has acknowledged nothing for 1.").size(), 1U);
}

/// The link stalls, too: another connection to that server is begun, and says hello.
TEST(ServerLinkInNetwork, AConnectionBegunAtASilentServerEndsWithTheOneBefore) {
  struct Rig : TwoServersRig {
    void run() {
      start_on_a_with_heartbeat();
      ASSERT_EQ(test::run({"ip", "link", "set", "lo", "down"}).status, 0);
      ask([](ServerLink& link) { return link.write(one_frame()), true; });
      log_.wait_for(" stalled, nothing acknowledged ");
      ASSERT_EQ(test::run({"ip", "link", "set", "lo", "up"}).status, 0);
      EXPECT_EQ(owner_.next(), "writable 0 0");
      EXPECT_EQ(owner_.next(), "disconnected 0 0");
      b_.welcome({});
      expect_connected_to(b_);
      EXPECT_EQ(log_.lines("has acknowledged nothing for 1.").size(), 1U);
      EXPECT_EQ(log_.lines("no answer").size(), 0U);
    }
  };
  test::in_own_network([] {
    ASSERT_EQ(test::run({"ip", "link", "set", "lo", "up"}).status, 0);
    Rig().run();
  });
}

TEST(ServerLinkInNetwork, AServerThatDoesNotAnswerIsNotWaitedFor) {
  test::in_own_network([] {
    for (const char* step :
         {"ip link set lo up", "ip link add hole type veth peer name end", "ip link set end up",
          "ip addr add 10.9.8.1/24 dev hole", "ip link set hole up",
          "ip neigh add 10.9.8.7 lladdr 02:00:00:00:00:07 dev hole"}) {
      ASSERT_EQ(test::run({"sh", "-c", step}).status, 0) << step;
    }
    LinkRig rig;
    rig.start({{"10.9.8.7", 7722}, address_of(rig.server_)});
    rig.server_.welcome({});
    rig.expect_connected();
  });
}

}  // namespace
}  // namespace orbbuf
