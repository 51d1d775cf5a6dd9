// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/server_link.hpp"

#include <gtest/gtest.h>

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/packaged_task.hpp>
#include <boost/asio/post.hpp>
#include <condition_variable>
#include <deque>
#include <future>
#include <mutex>
#include <thread>

#include "testing/captured_log.hpp"
#include "testing/own_network.hpp"
#include "testing/process.hpp"
#include "testing/scripted_server.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using wire::Type;

/// What a link calls, in order: each may be awaited by the test's thread.
class RecordingOwner final : public ServerLink::Owner {
 public:
  static constexpr Sequence kNeverWritten = 1000;

  void on_connected(const wire::Position& position) override { add("connected", position); }
  bool can_be_at(const wire::Position& position) const override {
    return position.next_sequence < kNeverWritten;
  }
  void on_disconnected() override { add("disconnected", {}); }
  void on_ack(const wire::Ack& ack) override { add("ack", ack.position); }
  void on_bye(const wire::Position& position) override { add("bye", position); }
  void on_writable() override { add("writable", {}); }

  /// The next call, as "connected 7 3".
  std::string next() {
    std::unique_lock lock(mutex_);
    called_.wait(lock, [this] { return !calls_.empty(); });
    std::string call = std::move(calls_.front());
    calls_.pop_front();
    return call;
  }

 private:
  void add(const std::string& name, const wire::Position& position) {
    const std::lock_guard lock(mutex_);
    calls_.push_back(name + " " + std::to_string(position.next_sequence) + " " +
                     std::to_string(position.next_drop));
    called_.notify_all();
  }

  std::mutex mutex_;
  std::condition_variable called_;
  std::deque<std::string> calls_;
};

/// A link on its own thread, as `main` is, against a server that the test plays.
class LinkRig {
 public:
  /// The test may be held up in the middle of a welcome.
  LinkRig() { settings_.connect_timeout = std::chrono::minutes(1); }
  void start() {
    settings_.server.port = server_.port();
    wire::Hello hello;
    hello.robot_id = "r";
    hello.session_id = "s";
    link_ = std::make_unique<ServerLink>(io_, settings_, hello,
                                         static_cast<ServerLink::Owner&>(owner_));
    link_->start();
    main_ = std::jthread([this] { io_.run(); });
  }
  /// What `ask` says of the link, on its thread.
  template <class Ask>
  auto ask(Ask ask) {
    std::packaged_task<decltype(ask(*link_))()> task([this, ask] { return ask(*link_); });
    return asio::post(io_, std::move(task)).get();
  }
  ServerLink::State state() {
    return ask([](const ServerLink& link) { return link.state(); });
  }
  std::string last_error() {
    return ask([](const ServerLink& link) { return link.last_error(); });
  }
  void expect_connected() {
    EXPECT_EQ(owner_.next(), "connected 0 0");
    EXPECT_EQ(owner_.next(), "writable 0 0");
    EXPECT_EQ(state(), ServerLink::State::kConnected);
    EXPECT_EQ(last_error(), "");
  }
  ~LinkRig() {
    asio::post(io_, [this] {
      link_->close();
      io_.stop();
    });
    if (main_.joinable()) main_.join();
  }

  LinkSettings settings_;
  test::ScriptedServer server_;
  asio::io_context io_;
  asio::executor_work_guard<asio::io_context::executor_type> work_{io_.get_executor()};
  RecordingOwner owner_;
  std::unique_ptr<ServerLink> link_;
  std::jthread main_;
};

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
  server_.send(wire::encode(wire::Welcome{wire::kProtocolVersion, {}}));
  expect_connected();
}

TEST_F(ServerLinkTest, APositionThatWasNeverWrittenIsARefusal) {
  start();
  server_.welcome({RecordingOwner::kNeverWritten, 0});
  server_.accept();  // the next attempt
  EXPECT_NE(
      last_error().find("reaches frame 1000 and drop record 0, which this robot has not sent"),
      std::string::npos)
      << last_error();
  server_.send(wire::encode(wire::Welcome{wire::kProtocolVersion, {7, 3}}));
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
    rig.server_.send(wire::encode(wire::Welcome{wire::kProtocolVersion, {}}));
    rig.expect_connected();
    EXPECT_EQ(log.lines("over 10.9.8.7; its record").size(), 1U);
    EXPECT_EQ(log.lines(" lost: ").size(), 0U);
  });
}

}  // namespace
}  // namespace orbbuf
