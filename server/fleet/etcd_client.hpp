// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/parser.hpp>
#include <boost/beast/http/string_body.hpp>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/address.hpp"
#include "common/error.hpp"
#include "common/net/stream.hpp"
#include "server/fleet/key_store.hpp"

namespace orbbuf {

/// Requests to etcd's JSON gateway: one connection that is kept, one request at a time, in order.
/// A request that fails for want of an answer is sent to the next endpoint, until its time is over;
/// so etcd may see it twice, and each must bear that.
///
/// Thread-bound to `main`; must outlive every run of the io_context.
class EtcdChannel {
 public:
  /// The body of a 200, or why there is none.
  using Done = std::function<void(Result<std::string>)>;

  struct Options {
    std::vector<Address> endpoints;  ///< at least one
    TlsSettings tls;
    std::chrono::milliseconds attempt{1000};   ///< for an endpoint to answer
    std::chrono::milliseconds patience{3000};  ///< for all attempts, from the call on
  };

  /// Throws std::runtime_error if the keys of options.tls cannot be used.
  EtcdChannel(boost::asio::io_context& main, Options options);

  /// `done` never runs from within the call.
  void async_post(std::string path, std::string body, Done done);
  /// Fails all that waits, and what comes after.
  void stop();

  const std::vector<Address>& endpoints() const { return options_.endpoints; }
  const Address& endpoint() const { return options_.endpoints[endpoint_]; }
  std::uint64_t requests() const { return requests_; }
  std::uint64_t failures() const { return failures_; }
  std::chrono::nanoseconds time_spent() const { return time_spent_; }

 private:
  using Clock = std::chrono::steady_clock;
  using Request = boost::beast::http::request<boost::beast::http::string_body>;
  using Parser = boost::beast::http::response_parser<boost::beast::http::string_body>;

  struct Call {
    std::string path;
    std::string body;
    Done done;
    Clock::time_point limit;
  };
  /// A connection and what is read from it: outlives the channel's use of it, for its operations.
  struct Link {
    Link(boost::asio::ip::tcp::socket socket, TlsContext* tls) : stream(std::move(socket), tls) {}
    Stream stream;
    boost::beast::flat_buffer buffer;
    Request request;
    std::optional<Parser> parser;
  };

  void next();
  void attempt();
  void connect();
  void send();
  void on_answer();
  void on_failed(const std::string& why);
  void disconnect();
  void finish(Result<std::string> answer);
  /// Wraps a step: ignored if the link has been given up meanwhile, on_failed() after an error.
  template <class Step>
  auto guarded(const char* what, Step step);

  boost::asio::io_context& main_;
  const Options options_;
  const std::shared_ptr<TlsContext> tls_;  // null: plain TCP
  boost::asio::ip::tcp::resolver resolver_;
  boost::asio::steady_timer timer_;
  std::deque<Call> calls_;
  std::shared_ptr<Link> link_;  // null: not connected
  bool is_connected_ = false;
  bool is_busy_ = false;
  bool is_stopped_ = false;
  std::size_t endpoint_ = 0;
  std::size_t failed_in_turn_ = 0;
  Clock::time_point begun_{};
  std::uint64_t requests_ = 0;
  std::uint64_t failures_ = 0;
  std::chrono::nanoseconds time_spent_{};
};

/// etcd, by the JSON gateway of its v3 API (3.4 and later): txns, ranges and leases. Several txns
/// are one request, in which they are nested: one write to etcd's log for all of them. Those of
/// several calls, too, if the calls come while a request is outstanding.
class EtcdClient final : public KeyStore {
 public:
  EtcdClient(boost::asio::io_context& main, EtcdChannel::Options options)
      : main_(main), channel_(main, std::move(options)) {}

  void async_txns(std::vector<KeyTxn> txns, Done<std::vector<KeyTxnOutcome>> done) override;
  void async_range(KeyRange range, Done<std::vector<KeyValue>> done) override;
  void async_grant(std::chrono::seconds ttl, Done<std::int64_t> done) override;
  void async_keep_alive(std::int64_t lease, Done<bool> done) override;
  void async_revoke(std::int64_t lease, Done<bool> done) override;

  void stop() { channel_.stop(); }
  const EtcdChannel& channel() const { return channel_; }

 private:
  struct Call {
    std::vector<KeyTxn> txns;
    Done<std::vector<KeyTxnOutcome>> done;
  };

  void send_txns();
  std::vector<Call> take_calls();

  boost::asio::io_context& main_;
  EtcdChannel channel_;
  std::deque<Call> waiting_;
  bool is_sent_ = false;  // a request with txns
};

}  // namespace orbbuf
