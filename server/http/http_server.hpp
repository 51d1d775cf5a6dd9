// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/net/stream.hpp"
#include "server/http/foxglove_server.hpp"
#include "server/http/request_reader.hpp"
#include "server/http/response.hpp"
#include "server/http/router.hpp"
#include "server/settings.hpp"

namespace orbbuf {

/// Shows the server to browsers and to Prometheus, read-only: accepts connections, as many as
/// kMaxConnections, beyond which longest_waiting() ends for each that comes, and answers requests;
/// those for Foxglove's WebSocket go to FoxgloveServer.
/// Under [tls] it asks for certificates as the link does. Thread-bound to `main`. Must outlive
/// every run of the io_context.
class HttpServer {
 public:
  static constexpr std::size_t kMaxConnections = 64;
  static constexpr std::chrono::seconds kRequestTime{5};  ///< from its first byte; and for TLS
  static constexpr std::chrono::seconds kIdleTime{15};    ///< between requests
  static constexpr std::chrono::seconds kPieceTime{5};    ///< to take a piece of an answer
  static constexpr std::chrono::seconds kPartingTime{1};

  /// Listens on settings.http_address, which must be set. Throws std::runtime_error, saying on what
  /// and why not. `metrics` must outlive it.
  HttpServer(boost::asio::io_context& main, boost::asio::thread_pool& files,
             const Settings& settings, Metrics& metrics);

  boost::asio::ip::tcp::endpoint endpoint() const { return acceptor_.local_endpoint(); }

  void start();
  /// The context of the connections that follow, after Listener::reload_tls().
  void use_tls(std::shared_ptr<TlsContext> tls) { tls_ = std::move(tls); }
  /// Closes everything at once.
  void stop();

 private:
  class Connection;

  static constexpr std::chrono::milliseconds kRetry{200};

  // Called by a connection.
  /// `answer` runs once, on `main`, from within the call or later.
  void on_request(const HttpRequest& request, Router::Answer answer);
  /// Of a request for WebSocket: whether on_upgrade() follows; else on_request() does.
  bool can_upgrade(const HttpRequest& request);
  /// The stream is the server's from here on; on_closed() follows.
  void on_upgrade(std::unique_ptr<Stream> stream, const HttpRequest& request);
  /// The last call: the socket is closed, or given away.
  void on_closed(const std::shared_ptr<Connection>& connection);

  void accept();
  void accept_later();

  PoolStrand files_;
  std::shared_ptr<TlsContext> tls_;  // null: plain TCP
  Router router_;
  std::shared_ptr<FoxgloveServer> foxglove_;
  boost::asio::ip::tcp::acceptor acceptor_;
  boost::asio::steady_timer retry_;
  std::set<std::shared_ptr<Connection>> connections_;
};

}  // namespace orbbuf
