// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/log.hpp"
#include "common/wire.hpp"
#include "server/live/metrics.hpp"
#include "server/session/session_info.hpp"
#include "server/sink/frame_sink.hpp"

namespace orbbuf {

/// The connection that serves a session at the moment, as its session sees it.
class SessionPeer {
 public:
  virtual ~SessionPeer() = default;
  /// The session is yours and stands at `position`: welcome the robot.
  virtual void on_attached(wire::Position position) = 0;
  /// What was taken so far may be acknowledged: Session::kept(). Also when that has not moved,
  /// while a sink fails: the robot must not take the server for a dead one.
  virtual void on_kept() = 0;
  /// The session is another connection's now, or the robot began a new one.
  virtual void on_replaced() = 0;
  /// Tell the robot to go to another server, since this one cannot keep what it sends: `why`.
  virtual void on_sent_away(const std::string& why) = 0;
  /// The session is over, its record ends at `position`: say bye.
  virtual void on_ended(wire::Position position) = 0;
  /// The session is over, and its end could not be recorded: no bye.
  virtual void on_end_lost() = 0;
};

/// Why a session ends.
enum class SessionEnd : std::uint8_t {
  kBye,         ///< the robot says so
  kSuperseded,  ///< the robot has begun another
  kAbandoned,   ///< no connection for too long
  kStopping,    ///< the server stops
  kDraining,    ///< the server takes no robots any more
  kUnkept,      ///< the device has failed: what is to come cannot be kept here
};

/// One run of a robot's daemon as the server has it: its sinks, how far they got, and which
/// connection may add to it. It survives connections.
///
/// A frame goes to one sink after the other and counts as taken when all have it. The next may then
/// come; the frame is acknowledged once it is kept (FrameSink::async_commit()), as is a position in
/// a welcome or a bye. A sink that fails
/// is tried again every second, which holds the robot's stream, since nothing more is read before;
/// it is logged once when that begins and once when it is over. A frame that no sink has taken
/// is given up when its connection goes: it was not acknowledged, so the robot still has it.
///
/// Thread-bound to `main`. Lives in a shared_ptr, held by its owner and by its timers; the calls at
/// sinks hold it weakly. The owner keeps it until Events::closed has run.
class Session : public std::enable_shared_from_this<Session> {
 public:
  /// Runs when the sinks have what was written, never from within the call. Not run for a
  /// connection that was replaced or detached meanwhile, nor by a session that is closing.
  using Taken = std::function<void()>;

  /// How long a session waits for others.
  struct Timeouts {
    std::chrono::nanoseconds connection;  ///< after one connection, for the next
    std::chrono::nanoseconds drain;       ///< when it closes, for the sinks
  };

  /// What the owner wants to know.
  struct Events {
    std::function<void()> closed;  ///< once: it has ended for whatever reason, all sinks are closed
    std::function<void()> sink_failed;  ///< at each failed try; may be empty
  };

  Session(boost::asio::io_context& main, SessionInfo info,
          std::vector<std::shared_ptr<FrameSink>> sinks, const Timeouts& timeouts, Events events);

  /// Tells `metrics` what happens from here on. At most once, before all else.
  void show(std::shared_ptr<RobotMetrics> metrics) { metrics_ = std::move(metrics); }

  /// Makes `peer` the one connection, replacing the present one. peer->on_attached() follows as
  /// soon as no sink is busy any more, possibly from within the call. Requires !is_closing().
  void attach(const std::shared_ptr<SessionPeer>& peer);
  /// The connection has gone. Does nothing if it was replaced before.
  void detach(const SessionPeer& peer);

  /// Requires that the last call was taken. Repeats are taken without writing them again.
  void write(FramePtr frame, Taken taken);
  /// count: how many they are. Requires that they are all below the position, or none is.
  void write_items(ItemsPtr items, std::uint64_t count, Taken taken);
  void on_report(const wire::Report& report);
  /// For the metrics: a late frame is kept, of this session or an earlier one.
  void on_late(bool is_present_session);
  /// For the metrics: what the robot still has.
  void on_account(const wire::Account& account);

  /// The robot ends the session, with its totals: close(SessionEnd::kBye) follows.
  void on_bye(const wire::Bye& bye);

  /// Ends the session when the sinks are done with what they have begun, or when `drain` is over.
  /// An end that cannot be recorded, on a full disk, is tried again every second, until the server
  /// stops.
  void close(SessionEnd end);
  /// Sends the robot to another server if what it sends cannot be kept: the device has failed,
  /// which ends the session, or two tries in a row to write something. Then the session stays open,
  /// and a robot that comes back stays for kStay: it has no other server.
  void step_aside(bool has_device_failed);

  bool is_closing() const { return life_ != Life::kOpen; }
  /// Why nothing is taken at the moment; empty: it is.
  const std::string& pause() const { return pause_; }
  /// Up to where the sinks have taken all.
  wire::Position position() const { return position_; }
  /// Up to where they keep it, on the device if that is asked for: never beyond position().
  wire::Position kept() const { return kept_; }
  /// The robot may send on behind it: position(), until a device has failed.
  Sequence received() const {
    return (keeping_ == Keeping::kFailed ? kept_ : position_)[wire::kFrames];
  }
  const SessionInfo& info() const { return info_; }

 private:
  /// What the sinks are given at the moment.
  struct Job {
    FramePtr frame;  // or, if null, items
    ItemsPtr items;
    wire::Position then;  // the session's position when all sinks have it
    Taken taken;          // empty: no connection waits for it
    std::size_t sink = 0;
    bool is_in_sink = false;  // else it waits for retry_
  };

  /// What was taken is brought onto the device.
  enum class Keeping : std::uint8_t {
    kIdle,
    kBusy,    ///< up to a position; what is taken meanwhile is next
    kFailed,  ///< nothing more is acknowledged
  };
  enum class PeerState : std::uint8_t {
    kNone,
    kWaiting,  ///< for on_attached()
    kAttached,
  };
  enum class Life : std::uint8_t {
    kOpen,
    kClosing,   ///< end_ says why; what was begun goes on
    kDraining,  ///< all that was begun has ended; one sink after the other finishes
  };

  static constexpr std::chrono::seconds kRetry{1};
  static constexpr std::chrono::seconds kNoteInterval{5};
  static constexpr std::chrono::seconds kStay{10};

  void begin(Job job);
  void repeat(Taken taken);
  void commit();
  void on_committed(const wire::Position& upto, const std::optional<Error>& error);
  void call_sink();
  void on_sink_done(const std::optional<Error>& error);
  void try_again(std::function<void()> work);
  std::size_t next_sink(std::size_t sink) const;
  void finish_job();
  void show_job() const;
  void show_samples(const wire::Items& items) const;
  void note();
  void show_losses() const;
  void note_failure(const std::optional<Error>& error);
  void on_waiter_gone();
  void settle();
  void start_timeout();
  void drain();
  void on_drained(const std::optional<Error>& error);
  void finish_close();

  boost::asio::io_context& main_;
  const SessionInfo info_;
  const std::string name_;  // for the log
  std::vector<std::shared_ptr<FrameSink>> sinks_;
  const Timeouts timeouts_;
  const Events events_;
  boost::asio::steady_timer timer_;  // until a connection comes, or the sinks drain
  boost::asio::steady_timer retry_;

  std::shared_ptr<RobotMetrics> metrics_;      // null: there is no page
  std::map<std::string, std::uint64_t> held_;  // by session: frames that the robot still has

  wire::Position position_;
  std::weak_ptr<SessionPeer> peer_;
  PeerState peer_state_ = PeerState::kNone;
  std::optional<Job> job_;
  wire::Position kept_;
  Keeping keeping_ = Keeping::kIdle;
  Life life_ = Life::kOpen;
  SessionEnd end_ = SessionEnd::kStopping;             // since kClosing
  bool is_stopping_ = false;                           // the server, since close()
  bool is_end_lost_ = false;                           // it could not be recorded
  std::string pause_;                                  // logged; empty: nothing fails
  int failures_ = 0;                                   // in a row, over whichever connections
  std::chrono::steady_clock::time_point stays_until_;  // the robot, whatever fails
  bool has_no_jpeg_ = false;                           // a frame, logged
  std::map<wire::StreamId, LogLimit> gaps_;
  SessionClosing closing_;
  std::optional<SessionClosing> noted_;  // by the sinks
  std::chrono::steady_clock::time_point noted_at_;
  std::size_t drained_ = 0;  // sinks
};

}  // namespace orbbuf
