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

class HttpConnection;

/// What a browser's connection needs from the server around it.
class HttpOwner {
 public:
  using Answer = std::function<void(HttpResponse)>;

  virtual ~HttpOwner() = default;
  /// `answer` runs once, on `main`, from within the call or later.
  virtual void on_request(const HttpRequest& request, Answer answer) = 0;
  /// Of a request for WebSocket: whether on_upgrade() follows; else on_request() does.
  virtual bool can_upgrade(const HttpRequest& request) = 0;
  /// The stream is the owner's from here on; on_closed() follows.
  virtual void on_upgrade(std::unique_ptr<Stream> stream, const HttpRequest& request) = 0;
  /// The last call: the socket is closed, or given away.
  virtual void on_closed(const std::shared_ptr<HttpConnection>& connection) = 0;
};

/// One browser's connection: a request, its answer, the next request. Whatever it does, or does not
/// do, costs the robots' streams nothing to speak of: it has a time for each request and each piece
/// of an answer, and is cut when that is over. What blocks is done on `files`, a piece at a time.
/// Thread-bound to `main`. Lives in a shared_ptr, held by its owner and its operations.
class HttpConnection final : public std::enable_shared_from_this<HttpConnection> {
 public:
  static constexpr std::chrono::seconds kRequestTime{5};  ///< from its first byte; and for TLS
  static constexpr std::chrono::seconds kIdleTime{15};    ///< between requests
  static constexpr std::chrono::seconds kPieceTime{5};    ///< to take a piece of an answer
  static constexpr std::chrono::seconds kPartingTime{1};

  /// `tls`: null for plain TCP. `files` and `owner` must outlive every run of the io_context.
  HttpConnection(boost::asio::ip::tcp::socket socket, TlsContext* tls,
                 boost::asio::thread_pool& files, HttpOwner& owner);

  void start();
  const boost::asio::ip::tcp::endpoint& peer() const { return peer_; }
  /// It has neither begun a request nor taken a piece of an answer since.
  std::chrono::steady_clock::time_point since() const { return since_; }
  /// At once; harmless when repeated.
  void close();

 private:
  bool serve();
  void go_on();
  void read();
  void on_bytes(std::size_t bytes);
  void ask(const HttpRequest& request);
  void give_away(const HttpRequest& request);
  void respond(HttpResponse response, bool is_head, bool keeps_alive);
  void write_next();
  void read_file();
  void write(std::span<const std::uint8_t> piece);
  void on_written();
  void part();
  void discard();
  void limit(std::chrono::seconds time);

  const boost::asio::ip::tcp::endpoint peer_;
  std::unique_ptr<Stream> stream_;  // null: given away
  boost::asio::thread_pool& files_;
  HttpOwner& owner_;
  boost::asio::steady_timer timer_;
  std::chrono::steady_clock::time_point since_;
  bool is_closed_ = false;

  RequestReader reader_;
  std::array<std::uint8_t, 4096> in_{};

  // The answer that is being written.
  HttpResponse response_;
  std::string head_;
  std::vector<std::uint8_t> piece_;  // of a file
  std::uint64_t written_ = 0;
  std::uint64_t left_ = 0;
  bool keeps_alive_ = false;
};

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
