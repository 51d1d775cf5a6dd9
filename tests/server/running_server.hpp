// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <csignal>
#include <cstdint>
#include <future>
#include <memory>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "server/http/http_server.hpp"
#include "server/link/listener.hpp"
#include "server/settings.hpp"

namespace orbbuf::test {

/// A whole server in this process, on any free loopback port, its `main` a thread of its own so
/// that tests may block. Stops gracefully at the end of its life, if not before.
class RunningServer {
 public:
  explicit RunningServer(Settings settings) {
    std::signal(SIGPIPE, SIG_IGN);
    settings.listen.address.port = 0;
    if (settings.http_address) http_.emplace(main_, files_, settings, metrics_);
    listener_.emplace(main_, files_, settings, http_ ? &metrics_ : nullptr);
    port_ = listener_->endpoint().port();
    listener_->start();
    if (http_) http_->start();
    thread_ = std::thread([this] { main_.run(); });
  }
  ~RunningServer() { stop(); }
  RunningServer(const RunningServer&) = delete;
  RunningServer& operator=(const RunningServer&) = delete;

  std::uint16_t port() const { return port_; }
  /// Of the page, if settings.http_address asks for one.
  std::uint16_t http_port() const { return http_->endpoint().port(); }

  bool has_session(const std::string& robot_id, const std::string& session_id) {
    std::promise<bool> answer;
    boost::asio::post(main_,
                      [&] { answer.set_value(listener_->has_session(robot_id, session_id)); });
    return answer.get_future().get();
  }

  /// As SIGHUP does it; returns when it is done.
  void reload_tls() {
    std::promise<void> done;
    boost::asio::post(main_, [&] {
      listener_->reload_tls();
      if (http_) http_->use_tls(listener_->tls());
      done.set_value();
    });
    done.get_future().get();
  }
  void allow(const std::vector<std::string>& robots) {
    std::promise<void> done;
    boost::asio::post(main_, [&] {
      listener_->allow(robots);
      done.set_value();
    });
    done.get_future().get();
  }

  /// As `orbbuf-server drain` does it; returns when it is over.
  void drain() {
    std::promise<void> done;
    boost::asio::post(main_, [&] { listener_->drain([&] { done.set_value(); }); });
    done.get_future().get();
  }

  /// As a signal does it; returns when the server has closed everything.
  void stop() {
    if (!thread_.joinable()) return;
    boost::asio::post(main_, [this] {
      if (http_) http_->stop();
      listener_->stop([] {});
    });
    thread_.join();  // `main` runs out of work when all is closed
  }

 private:
  boost::asio::io_context main_{1};
  boost::asio::thread_pool files_{2};
  Metrics metrics_{256};
  std::optional<HttpServer> http_;
  std::optional<Listener> listener_;
  std::uint16_t port_ = 0;
  std::thread thread_;
};

}  // namespace orbbuf::test
