// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "common/wire.hpp"
#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/net/backfill_pace.hpp"
#include "daemon/spool/spool.hpp"

namespace orbbuf {

/// Fills the spool from the buffer, and empties it to the server in the time that live frames
/// leave: docs/protocol.md, late frames. What a message is written to, and when live has nothing to
/// write, is the owner's matter.
///
/// Frames go to the spool when they are dropped, and those that have waited for a second, too,
/// since a robot that is killed would lose them. Thread-bound to `main`.
class Backfill {
 public:
  using Time = BackfillPace::Time;

  /// Late bytes that the server has not acknowledged, beyond two frames.
  static constexpr std::size_t kMostUnacknowledged = 4U << 20;

  /// `spool` and `buffer` must outlive it. wake: there may be something to write.
  Backfill(boost::asio::io_context& io, Spool& spool, FrameBuffer& buffer, std::string session_id,
           std::function<void()> wake);

  /// From the buffer to the spool: those that were dropped.
  void collect() { collect(false); }
  /// Once a second: those at risk as well.
  void collect_at_risk() { collect(true); }

  /// takes_late, max_frame_bytes: as the server's welcome says. Not called: nothing is sent.
  void on_connected(bool takes_late, std::uint32_t max_frame_bytes);
  void on_disconnected();
  void on_late_ack(std::uint64_t next);
  /// The spool may have something new.
  void on_spool_changed() { wake_(); }

  void on_captured(Time now) { pace_.on_captured(now); }
  /// Anything was written. bytes_per_s: of the link; 0: not known.
  void on_written(Time now, std::size_t bytes, double bytes_per_s) {
    pace_.on_written(now, bytes, bytes_per_s);
  }

  /// What the spool holds, if that is to be said now; else empty. final: before a bye, whenever it
  /// was last said.
  std::vector<std::uint8_t> take_spool_message(Time now, bool final = false);
  /// The next part of a late frame, if it may be written now: nothing live waits for the link. Else
  /// empty, and `wake` runs later if need be.
  /// busy_until: as BackfillPace::next() takes it.
  std::vector<std::uint8_t> take_part(Time now, double bytes_per_s, Time busy_until);

  Spool::Stats stats() const { return spool_.stats(); }

 private:
  static constexpr std::chrono::seconds kSpoolInterval{1};

  /// A frame that the spool has handed out, and the server has not acknowledged.
  struct Begun {
    std::size_t bytes = 0;
    bool is_sent = false;  // else it was passed over
  };

  void collect(bool those_at_risk);
  void begin_connection();
  bool begin_frame();
  void pass_over();
  void acknowledge(std::uint64_t sent);
  void wake_at(Time time);

  Spool& spool_;
  FrameBuffer& buffer_;
  const std::string session_id_;
  const std::function<void()> wake_;
  boost::asio::steady_timer timer_;
  BackfillPace pace_;
  FrameBuffer::ForSpool collected_;
  bool takes_late_ = false;
  std::uint32_t max_frame_bytes_ = 0;  // 0: not known
  // Of the connection:
  std::optional<SpooledFrame> next_;  // handed out by the spool, and not begun
  std::vector<std::uint8_t> record_;  // of the frame that is being sent; empty: none is
  std::size_t sent_ = 0;              // of record_
  std::uint64_t next_number_ = 0;
  std::deque<Begun> begun_;  // the oldest first
  std::size_t begun_bytes_ = 0;
  std::uint64_t acknowledged_ = 0;
  std::optional<wire::Spool> said_;
  Time said_time_;
  bool is_too_large_logged_ = false;
};

}  // namespace orbbuf
