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

/// Keeps a connection to the server: makes it anew whenever it breaks, and tries another beside it
/// while it stalls.
///
/// | state | connection | attempt | left when |
/// |---|---|---|---|
/// | resolving | - | - | the name is resolved: connecting; it is not: waiting |
/// | connecting | - | in flight | welcome: connected; failed or timed out: waiting |
/// | waiting | - | - | the delay is over: connecting, or resolving every 20th time |
/// | connected | moves | - | broken: waiting; nothing is acknowledged for too long: stalled |
/// | stalled | stands | in flight or waited for | the connection moves before the attempt has said
/// hello: connected; the attempt is welcome: connected, by it; broken: the attempt goes on alone |
/// | ended | - | - | never |
///
/// Thread-bound to `main`, the thread that runs the io_context.
class Link final : private ServerConnection::Owner {
 public:
  /// Called from the io_context only.
  class Owner {
   public:
    /// A connection is there, in place of an earlier one or not; the server's record reaches
    /// `position`. Writing may begin at the next on_writable().
    virtual void on_connected(const wire::Position& position) = 0;
    /// There is no connection any more. Not called before on_connected() replaces one.
    virtual void on_lost() = 0;
    virtual void on_ack(const wire::Position& position) = 0;
    /// The server's last message: all is recorded up to `position`, or it is going down.
    virtual void on_bye(const wire::Position& position) = 0;
    /// The kernel has little left unsent: the moment to choose the next message.
    virtual void on_writable() = 0;
    /// Ten times a second, connected or not.
    virtual void on_tick() = 0;

   protected:
    ~Owner() = default;
  };

  /// `owner` must outlive the link. Nothing happens before start(). Throws std::runtime_error if
  /// the keys of settings.tls cannot be used.
  Link(boost::asio::io_context& io, LinkSettings settings, wire::Hello hello, Owner& owner);
  ~Link();

  void start();
  /// Closes what is open. No more calls to the owner.
  void end();

  /// Whether the first attempt to connect has ended, well or not.
  bool has_tried() const { return has_tried_; }
  bool is_connected() const { return connection_ != nullptr; }
  bool is_stalled() const { return is_stalled_; }
  /// Why the last attempt failed; empty since the last one that did not.
  const std::string& last_error() const { return last_error_; }
  /// What the kernel said of the connection at the last tick; nothing without one.
  const std::optional<TcpProgress>& progress() const { return progress_; }

  /// Whether a message may be written: there is a connection, and nothing is being written.
  bool is_writable() const { return connection_ && connection_->is_writable(); }
  /// Both require is_writable().
  void write(std::vector<std::uint8_t> message) { connection_->write(std::move(message)); }
  void write(FramePtr frame) { connection_->write(std::move(frame)); }

 private:
  void on_step(const ServerConnection& from) override;
  void on_welcome(const wire::Position& position) override;
  void on_ack(const wire::Position& position) override { owner_.on_ack(position); }
  void on_bye(const wire::Position& position) override { owner_.on_bye(position); }
  void on_writable() override { owner_.on_writable(); }
  void on_failed(const ServerConnection& from, const Error& error) override;

  void resolve();
  void connect();
  void start_attempt_timer();
  void connect_again(std::chrono::nanoseconds delay);
  void on_attempt_failed(const Error& why, std::chrono::nanoseconds retry_delay);
  void on_connection_lost(const Error& why);
  void tick();
  void check_stall();
  void on_recovered();
  bool is_wanting_attempt() const;
  std::chrono::nanoseconds retry_delay();

  boost::asio::io_context& io_;
  const LinkSettings settings_;
  const std::unique_ptr<TlsContext> tls_;  // null: plain TCP
  const wire::Hello hello_;
  Owner& owner_;

  boost::asio::ip::tcp::resolver resolver_;
  std::vector<boost::asio::ip::tcp::endpoint> endpoints_;
  unsigned attempts_ = 0;                         // since the last welcome
  bool has_tried_ = false;                        // an attempt has ended
  std::string last_error_;                        // logged already
  std::shared_ptr<ServerConnection> attempt_;     // not yet welcome; null between attempts
  std::shared_ptr<ServerConnection> connection_;  // the one that was welcome; null without
  boost::asio::steady_timer attempt_timer_;       // the attempt's end, or the wait for the next
  std::minstd_rand random_;                       // many robots must not come back as one
  boost::asio::steady_timer tick_timer_;
  StallWatch stall_watch_;  // of connection_
  std::optional<TcpProgress> progress_;
  bool is_stalled_ = false;  // another connection is being tried
  // A timer that has expired by then cannot be cancelled any more.
  bool is_ended_ = false;
};

}  // namespace orbbuf
