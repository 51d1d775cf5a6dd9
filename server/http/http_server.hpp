// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <cstddef>
#include <memory>
#include <set>
#include <utility>

#include "server/http/foxglove_server.hpp"
#include "server/http/http_connection.hpp"
#include "server/http/router.hpp"
#include "server/settings.hpp"

namespace orbbuf {

/// Shows the server to browsers and to Prometheus, read-only: accepts connections, as many as
/// kMaxConnections, beyond which longest_waiting() ends for each that comes, and answers requests;
/// those for Foxglove's WebSocket go to FoxgloveServer.
/// Under [tls] it asks for certificates as the link does. Thread-bound to `main`. Must outlive
/// every run of the io_context.
class HttpServer final : private HttpOwner {
 public:
  static constexpr std::size_t kMaxConnections = 64;

  /// Listens on settings.http_address, which must be set. Throws std::runtime_error, saying on what
  /// and why not. `metrics` must outlive it, and what `fleet` asks.
  HttpServer(boost::asio::io_context& main, boost::asio::thread_pool& files,
             const Settings& settings, Metrics& metrics, FleetPage fleet = {});

  boost::asio::ip::tcp::endpoint endpoint() const { return acceptor_.local_endpoint(); }

  void start();
  /// The context of the connections that follow, after Listener::reload_tls().
  void use_tls(std::shared_ptr<TlsContext> tls) { tls_ = std::move(tls); }
  /// Closes everything at once.
  void stop();

 private:
  static constexpr std::chrono::milliseconds kRetry{200};

  void on_request(const HttpRequest& request, Answer answer) override;
  bool can_upgrade(const HttpRequest& request) override;
  void on_upgrade(std::unique_ptr<Stream> stream, const HttpRequest& request) override;
  void on_closed(const std::shared_ptr<HttpConnection>& connection) override;

  void accept();
  void accept_later();

  boost::asio::thread_pool& files_;
  std::shared_ptr<TlsContext> tls_;  // null: plain TCP
  Router router_;
  std::shared_ptr<FoxgloveServer> foxglove_;
  boost::asio::ip::tcp::acceptor acceptor_;
  boost::asio::steady_timer retry_;
  std::set<std::shared_ptr<HttpConnection>> connections_;
};

}  // namespace orbbuf
