// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/server_link.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <chrono>
#include <thread>

#include "testing/captured_log.hpp"
#include "testing/own_network.hpp"
#include "testing/process.hpp"
#include "testing/scripted_server.hpp"
#include "tests/daemon/net/link_rig.hpp"

namespace orbbuf {
namespace {

using test::LinkRig;
using test::RecordingOwner;
using wire::Type;

class ServerLinkTest : public ::testing::Test, protected LinkRig {};

TEST_F(ServerLinkTest, SaysHelloAndPassesOnWhatTheServerSays) {
  start();
  EXPECT_EQ(state(), ServerLink::State::kConnecting);
  const wire::Hello hello = server_.welcome({7, 3});
  EXPECT_EQ(hello.robot_id, "r");
  EXPECT_EQ(hello.session_id, "s");
  EXPECT_EQ(owner_.next(), "connected 7 3");
  EXPECT_EQ(owner_.next(), "writable 0 0");
  server_.ack({8, 3});
  EXPECT_EQ(owner_.next(), "ack 8 3");
  server_.send(wire::encode(wire::Bye{{8, 3}}));
  EXPECT_EQ(owner_.next(), "bye 8 3");
}

TEST_F(ServerLinkTest, WhyTheServerTakesNothingIsLoggedOnceOverAllConnections) {
  const test::CapturedLog log;
  const auto pause = [this] { return ask([](const ServerLink& link) { return link.pause(); }); };
  const auto full = wire::encode(wire::Ack{{0, 0}, 0, "write x: No space left on device"});
  start();
  for (int connection = 0; connection < 2; ++connection) {
    server_.welcome({});
    expect_connected();
    for (int i = 0; i < 2; ++i) {
      server_.send(full);
      EXPECT_EQ(owner_.next(), "ack 0 0");
    }
    EXPECT_EQ(pause(), "write x: No space left on device");
    if (connection > 0) break;
    server_.close();
    EXPECT_EQ(owner_.next(), "disconnected 0 0");
  }
  server_.ack({1, 0});
  EXPECT_EQ(owner_.next(), "ack 1 0");
  EXPECT_EQ(pause(), "");
  EXPECT_EQ(log.lines("takes nothing at the moment: write x: No space left on device").size(), 1U);
  EXPECT_EQ(log.lines("takes frames again").size(), 1U);
}

TEST_F(ServerLinkTest, IsWritableAgainWhenAMessageHasGone) {
  start();
  server_.welcome({});
  expect_connected();
  EXPECT_TRUE(ask([](ServerLink& link) {
    link.write(wire::encode(wire::Bye{{1, 2}}));
    return !link.is_writable();
  }));
  EXPECT_EQ(server_.read(Type::kBye).type(), Type::kBye);
  EXPECT_EQ(owner_.next(), "writable 0 0");
  EXPECT_TRUE(ask([](const ServerLink& link) { return link.is_writable(); }));
}

/// A robot that runs for days on a battery, and captures little.
TEST_F(ServerLinkTest, AConnectionAtRestHardlyWakesTheRobot) {
  start();
  server_.welcome({});
  expect_connected();
  const auto times_asleep = [this] {
    return ask([](const ServerLink&) {
      rusage used{};
      ::getrusage(RUSAGE_THREAD, &used);
      return used.ru_nvcsw;
    });
  };
  std::this_thread::sleep_for(std::chrono::milliseconds(100));  // until what was said has arrived
  const long before = times_asleep();
  std::this_thread::sleep_for(std::chrono::milliseconds(800));
  EXPECT_LT(times_asleep() - before, 8);
}

TEST_F(ServerLinkTest, ABrokenConnectionIsMadeAnew) {
  start();
  server_.welcome({});
  expect_connected();
  server_.close();
  EXPECT_EQ(owner_.next(), "disconnected 0 0");
  server_.welcome({});
  expect_connected();
}

TEST_F(ServerLinkTest, ServerThatNeverAnswersIsTriedAgain) {
  settings_.connect_timeout = std::chrono::seconds(2);
  start();
  server_.accept();
  server_.welcome({});
  expect_connected();
}

TEST_F(ServerLinkTest, ServerThatTalksNonsenseIsLeftAndTriedAgain) {
  start();
  server_.accept();
  server_.send({'H', 'T', 'T', 'P', '/', '1', '.', '1', ' ', '4',
                '0', '0', ' ', 'B', 'a', 'd', ' ', 'R', 'e', 'q'});
  server_.welcome({});
  expect_connected();
}

TEST_F(ServerLinkTest, ARefusalIsTheLastErrorUntilTheServerWelcomes) {
  start();
  server_.accept();
  server_.send(wire::encode(wire::ErrorMessage{wire::ErrorCode::kRefused, "full"}));
  server_.accept();  // the next attempt
  EXPECT_NE(last_error().find("full"), std::string::npos) << last_error();
  EXPECT_TRUE(ask([](const ServerLink& link) { return link.has_tried(); }));
  EXPECT_EQ(state(), ServerLink::State::kConnecting);
  server_.send(wire::encode(test::welcome_at({})));
  expect_connected();
}

TEST_F(ServerLinkTest, APositionThatWasNeverWrittenIsARefusal) {
  start();
  server_.welcome({RecordingOwner::kNeverWritten, 0});
  server_.accept();  // the next attempt
  EXPECT_NE(last_error().find(
                "reaches frame 1000 and drop record 0, which, or the samples there, this robot "
                "has not sent"),
            std::string::npos)
      << last_error();
  server_.send(wire::encode(test::welcome_at({7, 3})));
  EXPECT_EQ(owner_.next(), "connected 7 3");
}

TEST_F(ServerLinkTest, CloseEndsTheConnection) {
  start();
  server_.welcome({});
  expect_connected();
  ask([](ServerLink& link) {
    link.close();
    return true;
  });
  EXPECT_FALSE(server_.read());
  EXPECT_EQ(state(), ServerLink::State::kClosed);
  EXPECT_TRUE(ask([](const ServerLink& link) { return !link.is_connected(); }));
}

TEST_F(ServerLinkTest, AnInterfaceThatIsNotThereIsNamedAndAnotherCarriesTheStream) {
  const test::CapturedLog log;
  settings_.interfaces = {"gone0", "127.0.0.9"};
  start();
  server_.welcome({});
  expect_connected();
  EXPECT_EQ(log.lines("cannot use interface gone0: No such device; trying it again").size(), 1U);
  EXPECT_EQ(log.lines("over 127.0.0.9; its record").size(), 1U);
}

TEST_F(ServerLinkTest, ThePreferredInterfaceIsTheFirstToBeTried) {
  const test::CapturedLog log;
  settings_.interfaces = {"127.0.0.8", "127.0.0.9"};
  settings_.attempt_interval = std::chrono::minutes(1);
  start();
  server_.welcome({});
  expect_connected();
  EXPECT_EQ(log.lines("over 127.0.0.8; its record").size(), 1U);
}

TEST(ServerLinkInNetwork, TheStreamGoesBackToThePreferredInterface) {
  test::in_own_network([] {
    ASSERT_EQ(test::run({"ip", "link", "set", "lo", "up"}).status, 0);
    const test::CapturedLog log;
    LinkRig rig;
    rig.settings_.interfaces = {"10.9.8.7", "127.0.0.9"};
    rig.settings_.return_after = std::chrono::seconds(0);
    rig.start();
    rig.server_.welcome({});
    rig.expect_connected();
    EXPECT_EQ(log.lines("over 127.0.0.9; its record").size(), 1U);
    ASSERT_EQ(test::run({"ip", "addr", "add", "10.9.8.7/32", "dev", "lo"}).status, 0);
    rig.server_.accept_beside();
    rig.server_.send(wire::encode(wire::ErrorMessage{wire::ErrorCode::kRefused, "log in first"}));
    log.wait_for("no return to 10.9.8.7: the server says: log in first");
    EXPECT_EQ(rig.state(), ServerLink::State::kConnected);
    EXPECT_EQ(rig.last_error(), "");
    rig.server_.accept_beside();
    rig.server_.send(wire::encode(test::welcome_at({})));
    rig.expect_connected();
    EXPECT_EQ(log.lines("over 10.9.8.7; its record").size(), 1U);
    EXPECT_EQ(log.lines(" lost: ").size(), 0U);
  });
}

}  // namespace
}  // namespace orbbuf
