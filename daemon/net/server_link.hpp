// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/address.hpp"
#include "common/net/tls.hpp"
#include "common/wire.hpp"
#include "daemon/net/attempt_pace.hpp"
#include "daemon/net/link_interfaces.hpp"
#include "daemon/net/network_news.hpp"
#include "daemon/net/server_addresses.hpp"
#include "daemon/net/server_connection.hpp"
#include "daemon/net/stall_watch.hpp"

namespace orbbuf {

/// `[link]` of orbbufd.toml.
struct LinkSettings {
  /// The servers that may take the robot, at least one, all different: ServerAddresses.
  std::vector<Address> servers{{"127.0.0.1", 7722}};
  TlsSettings tls;  ///< `[tls]`; a server's certificate must be for the host of its address here
  /// Names of network interfaces, or source addresses, the preferred one first. Attempts go over
  /// each in turn. Empty: over the one that the kernel chooses.
  std::vector<std::string> interfaces;
  /// How long the preferred interface must have reached the server before the stream returns to it.
  std::chrono::nanoseconds return_after = std::chrono::seconds(5);
  /// From one attempt to connect to the next, less than 30 % more at random: AttemptPace. With
  /// several interfaces: over each of them.
  std::chrono::nanoseconds attempt_interval = std::chrono::milliseconds(100);
  /// How long to wait at most for each step of an attempt: TCP, TLS, the welcome. Attempts do not
  /// wait for each other.
  std::chrono::nanoseconds connect_timeout = std::chrono::seconds(5);
  /// Beside a connection whose kernel has sent something and seen none of it acknowledged for this
  /// long (or two round trips, if that is longer) others are tried.
  std::chrono::nanoseconds stall_timeout = std::chrono::milliseconds(300);
  /// A connection whose server acknowledges none of the frames that its kernel has taken is
  /// replaced after this long; after 1 s if the server has a heartbeat.
  std::chrono::nanoseconds ack_timeout = std::chrono::seconds(60);
  /// At the end: how long to go on delivering what waits.
  std::chrono::nanoseconds drain_timeout = std::chrono::seconds(10);
  /// What the kernel may hold unsent: frames in there are beyond the policy.
  std::uint64_t unsent_bytes = 16U << 10;
};

/// Keeps one connection to the server: makes it, watches it, and replaces it when it breaks or
/// stalls, until close(). What is written to it is the owner's choice.
///
/// | state         | connection     | attempts | the next state, and when                         |
/// |---------------|----------------|----------|--------------------------------------------------|
/// | kConnecting   | none           | yes      | kConnected: the server welcomes one              |
/// | kConnected    | the link's own | a probe  | kConnecting: the connection breaks, or the       |
/// |               |                |          | server acknowledges no frame for ack_timeout     |
/// |               |                |          | kStalled: the server's kernel acknowledges       |
/// |               |                |          | nothing for stall_timeout                        |
/// | kStalled      | the link's own | yes      | kConnected, on the old connection: it recovers   |
/// |               |                |          | before a new one says hello                      |
/// |               |                |          | kConnected, on the new one: the server welcomes  |
/// |               |                |          | it                                               |
/// |               |                |          | kConnecting: the old connection breaks           |
/// | kClosed       | none           | none     |                                                  |
///
/// Attempts overlap: AttemptPace says when the next begins, whatever has become of those before,
/// and each may wait for connect_timeout. When there are kMostAttempts for each interface (twice as
/// many with several servers, since they go to two at a time), the next takes the place of an older
/// one, but never of the oldest to each address over each interface: the many find a link that has
/// just returned, and the oldest one with a long round trip.
///
/// The first attempt on which TCP connects becomes the candidate, and the others are closed. Only a
/// candidate says hello: at a second hello the server would leave the first connection. A candidate
/// on which something is outstanding for stall_timeout has lost the link; then attempts begin
/// beside it, and the next one to connect takes its place. Whichever hello the server reads last,
/// its welcome settles which frames it has.
///
/// With several interfaces, and the stream not on the preferred one, an attempt over that one each
/// second is a probe: one that connects is closed, until LinkInterfaces says that it is time to go
/// back. That one becomes a candidate beside the connection, which goes on until the welcome.
///
/// A server that refuses the robot, or fails it in another way once TCP is there, is left for the
/// others at once; only if all of them do so, the intervals grow. They do not grow for one that
/// sends the robot away (wire::ErrorCode::kSentAway): others are next.
///
/// The addresses of a name are looked up beside the attempts, which go on with those last known.
/// Thread-bound to `main`, the thread that runs the io_context.
class ServerLink final : private ServerConnection::Owner {
 public:
  using Clock = std::chrono::steady_clock;

  enum class State : std::uint8_t { kConnecting, kConnected, kStalled, kClosed };

  /// What the link serves. Called from the io_context only, never from within a call to the link.
  class Owner {
   public:
    /// A new connection, in the place of the one before if there was one: what was written to that
    /// and is not in the server's record, which reaches `position`, is lost. on_writable() follows.
    virtual void on_connected(const wire::Position& position) = 0;
    /// False if a server's record cannot reach `position`, since not so much was ever written.
    virtual bool can_be_at(const wire::Position& position) const = 0;
    /// The connection broke.
    virtual void on_disconnected() = 0;
    virtual void on_ack(const wire::Ack& ack) = 0;
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

  /// For SIGHUP: reads the files of settings.tls again, for new connections.
  void reload_tls();

  State state() const { return state_; }
  bool is_connected() const { return connection_ != nullptr; }
  bool is_stalled() const { return state_ == State::kStalled; }
  /// Why the server of the connection takes nothing at the moment, as it says; empty: it does.
  const std::string& pause() const { return pause_; }
  /// The server of the connection. Requires is_connected().
  const Address& server() const { return connection_->way().to.server; }
  /// Whether the first attempt to connect has ended, well or not.
  bool has_tried() const { return has_tried_; }
  /// Why the last attempt failed; empty since the last one that did not.
  const std::string& last_error() const { return last_error_; }

  /// True between on_writable() and the next write, or the connection's end.
  bool is_writable() const { return connection_ && connection_->is_writable(); }
  /// The largest frame that the server accepts; 0: not known. A larger one costs the connection.
  std::uint32_t max_frame_bytes() const {
    return connection_ ? connection_->welcome().max_frame_bytes : 0;
  }
  /// Whether the server takes items of that stream.
  bool takes(wire::StreamId stream) const {
    return connection_ && connection_->welcome().takes[stream];
  }
  /// Requires is_writable().
  void write(std::vector<std::uint8_t> message) {
    watch_closely();
    connection_->write(std::move(message));
  }
  /// Returns the bytes of the message.
  std::size_t write(const wire::Items& items) {
    ack_watch_.on_item(items.stream, items.first);
    auto message = wire::encode(items);
    const std::size_t bytes = message.size();
    write(std::move(message));
    return bytes;
  }
  void write(FramePtr frame) {
    watch_closely();
    ack_watch_.on_item(wire::kFrames, frame->sequence);
    connection_->write(std::move(frame));
  }

  /// What the kernel says of the connection; nothing without one.
  std::optional<TcpProgress> progress() const;

 private:
  void on_step(const ServerConnection& from) override;
  std::optional<Error> refusal_of(const wire::Position& position) override;
  void on_welcome(const wire::Position& position) override;
  void on_ack(const wire::Ack& ack) override;
  void on_bye(const wire::Position& position) override { owner_.on_bye(position); }
  void on_writable() override { owner_.on_writable(); }
  void on_failed(const ServerConnection& from, const Error& error) override;

  struct Attempt {
    std::shared_ptr<ServerConnection> connection;
    Clock::time_point since;
  };

  static constexpr std::size_t kMostAttempts = 8;

  bool is_attempt_due() const;
  void begin_outage();
  void attempt();
  void open(const ServerConnection::Way& way);
  void probe();
  void attempt_at(Clock::time_point time);
  void make_room();
  void give_up(std::vector<Attempt>::iterator attempt);
  void close_attempts();
  void look_up();
  void on_found(const Address& server, const Result<NameLookup::Endpoints>& endpoints);
  void on_not_found(const Address& server, const Error& why);
  void on_network_change();
  void note_failure(const Address& server, const Error& why);
  bool is_wanted(const ServerConnection& answered);
  void promote(const ServerConnection& from);
  void on_candidate_failed(const Error& why);
  void on_return_failed(const Error& why);
  void on_connection_lost(const ServerConnection& from, const Error& why);
  void leave(const Address& server, Clock::time_point ready);
  void on_refused(const ServerConnection& from);
  std::chrono::nanoseconds patience() const;
  bool is_silent() const;
  void watch();
  bool is_anything_open(const std::optional<TcpProgress>& progress) const;
  void watch_closely();
  void check_attempts();
  void check_candidate();
  void check_connection();
  void on_silence();
  void on_recovered();
  void end_stall();

  boost::asio::io_context& io_;
  const LinkSettings settings_;
  std::shared_ptr<TlsContext> tls_;  // null: plain TCP
  const wire::Hello hello_;
  Owner& owner_;

  State state_ = State::kConnecting;
  std::shared_ptr<ServerConnection> connection_;  // the one that was welcome; null without
  StallWatch connection_watch_;
  AckWatch ack_watch_;
  std::chrono::steady_clock::time_point check_time_{};  // of check_connection()
  std::shared_ptr<ServerConnection> candidate_;         // to be welcome: TCP is there; null without
  StallWatch candidate_watch_;
  Clock::time_point step_time_;    // when the candidate began its present step
  std::vector<Attempt> attempts_;  // oldest first: TCP is not there yet
  LinkInterfaces interfaces_;
  AttemptPace pace_;
  SegmentSize segment_size_;
  bool has_tried_ = false;              // an attempt has ended
  std::string last_error_;              // of the last attempt
  Address pausing_;                     // the server of the last welcome,
  std::string pause_;                   // and what it said; logged
  std::set<std::string> known_errors_;  // since the last welcome; logged already

  ServerAddresses addresses_;
  std::vector<ServerAddress> round_;  // where the attempts of a round of interfaces go
  NameLookup lookup_;
  Clock::time_point lookup_time_;  // of the last
  NetworkNews news_;
  boost::asio::steady_timer attempt_timer_;
  boost::asio::steady_timer watch_timer_;
  bool is_idle_ = false;  // nothing can go wrong: it is hardly watched
};

}  // namespace orbbuf
