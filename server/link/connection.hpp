// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <bitset>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

#include "common/log.hpp"
#include "common/net/stream.hpp"
#include "common/wire.hpp"
#include "server/link/message_reader.hpp"
#include "server/link/session.hpp"
#include "server/session/session_stores.hpp"
#include "server/settings.hpp"

namespace orbbuf {

class Connection;

/// What a connection needs from the server around it.
class ConnectionOwner {
 public:
  virtual ~ConnectionOwner() = default;
  /// Must end in connection->join() or connection->refuse().
  virtual void on_hello(const std::shared_ptr<Connection>& connection,
                        const wire::Hello& hello) = 0;
  /// Null: nothing is kept on disk, and late frames are not taken.
  virtual SessionStores* stores() = 0;
  /// The last call: the socket is closed.
  virtual void on_closed(const std::shared_ptr<Connection>& connection) = 0;
};

/// One robot's TCP connection: hello and welcome, then message after message, one at a time. The
/// next is read only when the session has taken this one, so a slow sink closes the TCP window.
///
/// Its states, beside those of its session (Session), which outlives it:
///
///   connection  [handshake ->] hello -> joining -> serving -> parting -> closed
///                                          |          ^ |         ^
///                                 attach() |          | |         | on_replaced(), on_ended()
///                                          v          | v         |
///   session          awaited ------> settling -> attached --> closing -> closed
///                       ^            (no sink         |
///                       |            is busy)         | detach(): until `Timeouts::connection`
///                       +-----------------------------+
///
/// Parting may follow upon any state, after a fault; closing upon any, after a bye, a newer session
/// or the server's stop. Under TLS a robot is who its certificate says.
///
/// A fault costs the connection and nothing else: one log line, an error message to the robot, the
/// end. Whatever the last message is, the socket is read (and what comes discarded) until the robot
/// has closed its side too, at most a second: closing earlier would make the kernel reset the
/// connection and might lose that message on its way.
///
/// Thread-bound to `main`. Lives in a shared_ptr, held by its owner from start() to closed() and by
/// its socket's and timer's operations; its session holds it weakly.
class Connection final : public SessionPeer, public std::enable_shared_from_this<Connection> {
 public:
  /// `tls`: null for plain TCP. `settings` and `owner` must outlive every run of the io_context.
  Connection(boost::asio::ip::tcp::socket socket, std::shared_ptr<TlsContext> tls,
             const ListenSettings& settings, ConnectionOwner& owner);

  void start();
  /// Answers the hello by joining `session`.
  void join(std::shared_ptr<Session> session);
  /// Answers the hello, or ends the wait for one, by an error message and the end.
  void refuse(std::string_view why, LogLevel level = LogLevel::kWarn);
  /// Tells the robot that this server lives: every wire::kHeartbeat.
  void beat() { on_kept(); }
  bool is_introduced() const { return state_ > State::kHello; }
  /// It serves no robot: it has not said hello, or it is over.
  bool is_stranger() const { return robot_id_.empty() || state_ >= State::kParting; }
  std::chrono::steady_clock::time_point since() const { return since_; }
  /// At once, without a word; harmless when repeated.
  void close();
  const boost::asio::ip::tcp::endpoint& peer() const { return peer_; }
  const std::string& robot_id() const { return robot_id_; }

  void on_attached(wire::Position position) override;
  void on_kept() override;
  void on_replaced() override;
  void on_sent_away(const std::string& why) override;
  void on_end_lost() override { refuse("the end of the session could not be recorded"); }
  void on_ended(wire::Position position) override { part(encode(wire::Bye{position})); }

 private:
  enum class State : std::uint8_t { kHandshake, kHello, kJoining, kServing, kParting, kClosed };
  /// Items of a stream that SessionStores writes, while others come. One that fails is tried again
  /// and is then behind others.
  struct Aside {
    std::uint64_t begun = 0;
    std::uint64_t written = 0;        // of them, in any order
    std::uint64_t kept = 0;           // all below it
    std::set<std::uint64_t> kept_on;  // of those beyond
    std::uint64_t discarded = 0;

    std::uint64_t begin() { return begun++; }
    /// That are being written.
    std::uint64_t count() const { return begun - written - discarded; }
    void discard() {
      ++begun;
      ++discarded;
    }
  };

  void shake_hands();
  void on_handshake_failed(const boost::system::error_code& failed);
  void read();
  void on_bytes(const boost::system::error_code& failed, std::size_t bytes);
  void on_read_failed(const boost::system::error_code& failed);
  void handle(Message message);
  void handle_hello(const Message& message);
  bool expect_near(const char* what, std::uint64_t number, std::uint64_t position);
  void handle_frame(Message message);
  void handle_items(const Message& message);
  std::optional<std::uint64_t> check_drops(const wire::Items& items);
  std::optional<std::uint64_t> check_samples(const wire::Items& items);
  void handle_late(const wire::Items& items);
  void handle_account(const wire::Items& items);
  void on_aside_kept(Aside& writes, std::uint64_t number, const Result<bool>& kept);
  SessionStores::Written when_written(Aside Connection::*writes);
  void on_aside_written();
  void read_aside();
  void discard(Aside& writes);
  void on_taken();

  void fail(const wire::Fault& fault, LogLevel level = LogLevel::kWarn);
  void part(std::vector<std::uint8_t> last_words);
  void send(std::vector<std::uint8_t> message);
  void send_next();
  void start_timer(std::chrono::nanoseconds time);
  void stop_timer() { deadline_ = std::chrono::steady_clock::time_point::max(); }
  void await_deadline();
  void on_deadline();
  std::string name() const;

  const boost::asio::ip::tcp::endpoint peer_;
  const std::chrono::steady_clock::time_point since_ = std::chrono::steady_clock::now();
  const std::shared_ptr<TlsContext> tls_;
  Stream stream_;
  const ListenSettings& settings_;
  ConnectionOwner& owner_;
  std::string robot_id_;  // empty: no hello yet
  std::string software_;
  std::shared_ptr<Session> session_;
  State state_ = State::kHello;
  // Hello, idle or parting, one at a time. The timer wakes at the deadline or before it.
  std::chrono::steady_clock::time_point deadline_ = std::chrono::steady_clock::time_point::max();
  boost::asio::steady_timer timer_;
  bool is_timer_running_ = false;

  MessageReader reader_;
  std::bitset<wire::kMostStreams> takes_;  // as the welcome says
  LateAssembly late_;
  Aside late_writes_;
  Aside account_writes_;
  bool is_held_ = false;        // nothing is read before some of these are written
  bool is_discarding_ = false;  // all more of them: these cannot be written
  std::array<std::uint8_t, 4096> discarded_{};
  bool is_reading_ = false;
  bool has_peer_closed_ = false;

  // Writes: one at a time. Acks are cumulative, so the one that waits is always the newest.
  std::vector<std::uint8_t> out_;
  std::vector<std::uint8_t> waiting_;  // welcome, last words; before any ack
  bool is_ack_due_ = false;
  Sequence received_ = 0;  // as the last ack said it
  bool is_writing_ = false;
};

}  // namespace orbbuf
