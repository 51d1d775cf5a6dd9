// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/packaged_task.hpp>
#include <boost/asio/post.hpp>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <future>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/net/server_link.hpp"
#include "testing/scripted_server.hpp"

namespace orbbuf::test {

namespace asio = boost::asio;
/// What a link calls, in order: each may be awaited by the test's thread.
class RecordingOwner final : public ServerLink::Owner {
 public:
  static constexpr Sequence kNeverWritten = 1000;

  void on_connected(const wire::Position& position) override { add("connected", position); }
  bool can_be_at(const wire::Position& position) const override {
    return position[wire::kFrames] < kNeverWritten;
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
    calls_.push_back(name + " " + std::to_string(position[wire::kFrames]) + " " +
                     std::to_string(position[wire::kDrops]));
    called_.notify_all();
  }

  std::mutex mutex_;
  std::condition_variable called_;
  std::deque<std::string> calls_;
};

inline Address address_of(const ScriptedServer& server) { return {"127.0.0.1", server.port()}; }

/// A link on its own thread, as `main` is, against a server that the test plays.
class LinkRig {
 public:
  /// The test may be held up in the middle of a welcome.
  LinkRig() { settings_.connect_timeout = std::chrono::minutes(1); }
  void start() { start({address_of(server_)}); }
  void start(std::vector<Address> servers) {
    settings_.servers = std::move(servers);
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
  ~LinkRig() { stop(); }
  /// The thread has ended. Also by itself at the end; before, for a test whose log ends sooner.
  void stop() {
    if (!main_.joinable()) return;
    asio::post(io_, [this] {
      link_->close();
      io_.stop();
    });
    main_.join();
  }

  LinkSettings settings_;
  ScriptedServer server_;
  asio::io_context io_;
  asio::executor_work_guard<asio::io_context::executor_type> work_{io_.get_executor()};
  RecordingOwner owner_;
  std::unique_ptr<ServerLink> link_;
  std::jthread main_;
};

}  // namespace orbbuf::test
