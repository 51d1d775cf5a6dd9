// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "common/address.hpp"
#include "common/net/tls.hpp"
#include "common/wire.hpp"
#include "daemon/net/server_connection.hpp"
#include "daemon/net/stall_watch.hpp"

namespace orbbuf {

/// `[link]` of orbbufd.toml.
struct LinkSettings {
  Address server{"127.0.0.1", 7722};
  TlsSettings tls;  ///< `[tls]`; the server's certificate must be for server.host
  /// For each step of an attempt: TCP, TLS, the welcome. Must exceed the link's round trip.
  std::chrono::nanoseconds connect_timeout = std::chrono::milliseconds(500);
  /// Beside a connection whose kernel has sent something and seen none of it acknowledged for this
  /// long (or four round trips, if that is longer) another is tried.
  std::chrono::nanoseconds stall_timeout = std::chrono::seconds(1);
  /// At the end: how long to go on delivering what waits.
  std::chrono::nanoseconds drain_timeout = std::chrono::seconds(10);
  /// What the kernel may hold unsent: frames in there are beyond the policy.
  std::uint64_t unsent_bytes = 16U << 10;
};

/// Keeps one connection to the server: makes it, watches it, and makes it anew when it breaks or
/// stalls, until close(). What is written to it is the owner's choice.
///
/// | state         | connection     | attempt          | the next state, and when                 |
/// |---------------|----------------|------------------|------------------------------------------|
/// | kConnecting   | none           | one, or a pause  | kConnected: the server welcomes          |
/// | kConnected    | the link's own | none             | kConnecting: the connection breaks       |
/// |               |                |                  | kStalled: the server's kernel            |
/// |               |                |                  | acknowledges nothing for stall_timeout   |
/// | kStalled      | the link's own | one, or a pause  | kConnected, on the old connection: it    |
/// |               |                |                  | recovers before the new one says hello   |
/// |               |                |                  | kConnected, on the new one: the server   |
/// |               |                |                  | welcomes it                              |
/// |               |                |                  | kConnecting: the old connection breaks   |
/// | kClosed       | none           | none             |                                          |
///
/// An attempt resolves the server's name, if that is not known or 20 attempts old, connects, and
/// says hello. One that fails is followed by a pause of 125 to 375 ms; one that times out, by the
/// next attempt. Thread-bound to `main`, the thread that runs the io_context.
class ServerLink final : private ServerConnection::Owner {
 public:
  enum class State : std::uint8_t { kConnecting, kConnected, kStalled, kClosed };

  /// Called from the io_context only, never from within a call to the link.
  class Owner {
   public:
    /// A new connection, in the place of the one before if there was one: what was written to that
    /// and is not in the server's record, which reaches `position`, is lost. on_writable() follows.
    virtual void on_connected(const wire::Position& position) = 0;
    /// The connection broke.
    virtual void on_disconnected() = 0;
    virtual void on_ack(const wire::Position& position) = 0;
    /// The server's last message on this connection: its record reaches `position`.
    virtual void on_bye(const wire::Position& position) = 0;
    /// The kernel has little left to send: the moment to choose the next message.
    virtual void on_writable() = 0;

   protected:
    ~Owner() = default;
  };

  /// `owner` must outlive the link. Nothing happens before start(). Throws std::runtime_error if
  /// the keys of settings.tls cannot be used.
  ServerLink(boost::asio::io_context& io, LinkSettings settings, wire::Hello hello, Owner& owner);
  ~ServerLink();

  void start();
  /// Ends connection and attempts at once. No more calls to the owner.
  void close();

  State state() const { return state_; }
  bool is_connected() const { return connection_ != nullptr; }
  bool is_stalled() const { return state_ == State::kStalled; }
  /// Whether the first attempt to connect has ended, well or not.
  bool has_tried() const { return has_tried_; }
  /// Why the last attempt failed; empty since the last one that did not.
  const std::string& last_error() const { return last_error_; }

  /// True between on_writable() and the next write, or the connection's end.
  bool is_writable() const { return connection_ && connection_->is_writable(); }
  /// Requires is_writable().
  void write(std::vector<std::uint8_t> message) { connection_->write(std::move(message)); }
  void write(FramePtr frame) { connection_->write(std::move(frame)); }

  /// What the kernel says of the connection; nothing without one.
  std::optional<TcpProgress> progress() const;

 private:
  void on_step(const ServerConnection& from) override;
  void on_welcome(const wire::Position& position) override;
  void on_ack(const wire::Position& position) override;
  void on_bye(const wire::Position& position) override;
  void on_writable() override;
  void on_failed(const ServerConnection& from, const Error& error) override;

  void attempt();
  void resolve();
  void connect();
  void start_attempt_timer();
  void attempt_later(std::chrono::nanoseconds delay);
  void on_attempt_failed(const Error& why, std::chrono::nanoseconds delay);
  void on_connection_lost(const Error& why);
  bool is_attempt_due() const;
  std::chrono::nanoseconds retry_delay();
  void watch();
  void check_stall();
  void on_recovered();

  boost::asio::io_context& io_;
  const LinkSettings settings_;
  const std::unique_ptr<TlsContext> tls_;  // null: plain TCP
  const wire::Hello hello_;
  Owner& owner_;

  State state_ = State::kConnecting;
  std::shared_ptr<ServerConnection> connection_;  // the one that was welcome; null without
  std::shared_ptr<ServerConnection> attempt_;     // not yet welcome; null between attempts
  unsigned attempts_ = 0;                         // since the last welcome
  bool has_tried_ = false;                        // an attempt has ended
  std::string last_error_;                        // logged already

  boost::asio::ip::tcp::resolver resolver_;
  std::vector<boost::asio::ip::tcp::endpoint> endpoints_;  // empty: to be resolved
  boost::asio::steady_timer attempt_timer_;                // the attempt's end, or the pause's
  boost::asio::steady_timer watch_timer_;
  std::minstd_rand random_;  // many robots must not come back as one
  StallWatch stall_watch_;   // of connection_
};

}  // namespace orbbuf
