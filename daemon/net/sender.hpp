// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <string>
#include <vector>

#include "common/address.hpp"
#include "common/drop_record.hpp"
#include "common/net/tls.hpp"
#include "common/wire.hpp"
#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/net/drop_log.hpp"
#include "daemon/net/link_rate.hpp"
#include "daemon/net/reporter.hpp"
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

/// Takes frames from the buffer to the server over one connection, made anew whenever it breaks,
/// until finish(). While it stalls others are attempted beside it; if it moves before one of them
/// has said hello it goes on, else the first that is welcome takes its place. The next frame is
/// chosen when the kernel has nearly nothing left to send (paper, Sec. III-E: transmission of a
/// message begins when the last is complete), and less than a window of frames is written and not
/// acknowledged: 3 frames, or what link and server take in two round trips and 100 ms, whichever is
/// more. So a slow SLAM program leaves the choice to the policy, and a server that never
/// acknowledges cannot make the robot hold more. Every frame stays in the buffer's account until
/// the server has acknowledged it; every drop record is sent until acknowledged. Thread-bound to
/// `main`, the thread that runs the io_context.
class Sender final : private ServerConnection::Owner {
 public:
  /// `buffer` and `drops` must outlive the sender. Nothing happens before start(). Throws
  /// std::runtime_error if the keys of settings.tls cannot be used.
  Sender(boost::asio::io_context& io, LinkSettings settings, wire::Hello hello, FrameBuffer& buffer,
         DropLog& drops);
  ~Sender();

  void start();

  /// There may be something new to send.
  void wake();

  /// Whether the first attempt to connect has ended, well or not.
  bool has_tried() const { return has_tried_; }
  bool is_connected() const { return connection_ != nullptr; }
  bool is_stalled() const { return is_stalled_; }
  /// Why the last attempt failed; empty since the last one that did not.
  const std::string& last_error() const { return last_error_; }

  /// No more frames will come: delivers what waits, for at most drain_timeout, gives up the rest by
  /// name, and says bye. Then `done` is called, with true if the server has the whole record.
  void finish(std::function<void(bool complete)> done);

 private:
  void on_step(const ServerConnection& from) override;
  void on_welcome(const wire::Position& position) override;
  void on_ack(const wire::Position& position) override;
  void on_bye(const wire::Position& position) override;
  void on_writable() override;
  void on_failed(const ServerConnection& from, const Error& error) override;

  void resolve();
  void connect();
  void start_attempt_timer();
  void connect_again(std::chrono::nanoseconds delay);
  void attempt_failed(const Error& why, std::chrono::nanoseconds retry_delay);
  void connection_lost(const Error& why);
  void write_next();
  bool is_window_open() const;
  void collect_drops();
  bool is_settled() const;
  std::vector<std::uint8_t> next_report();
  void say_bye();
  void tick();
  void check_stall(const std::optional<TcpProgress>& progress);
  void moved();
  bool is_wanting_attempt() const;
  std::chrono::nanoseconds retry_delay();
  void give_up_waiting();
  void end(bool complete);

  boost::asio::io_context& io_;
  const LinkSettings settings_;
  const std::unique_ptr<TlsContext> tls_;  // null: plain TCP
  const wire::Hello hello_;
  FrameBuffer& buffer_;
  DropLog& drops_;
  std::vector<DropRecord> collected_;  // on their way from buffer_ to drops_

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
  boost::asio::steady_timer drain_timer_;

  StallWatch stall_watch_;   // of connection_
  bool is_stalled_ = false;  // another connection is being tried
  LinkRate link_rate_;
  std::chrono::nanoseconds min_round_trip_{0};  // the last connection's
  Reporter reporter_;
  bool is_drops_turn_ = false;
  bool is_bye_sent_ = false;
  std::function<void(bool)> done_;  // set: finishing
  // A timer that has expired by then cannot be cancelled any more.
  bool is_ended_ = false;
};

}  // namespace orbbuf
