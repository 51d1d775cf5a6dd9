// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <string>
#include <vector>

#include "common/wire.hpp"
#include "daemon/record/record.hpp"

namespace orbbuf {

/// Says when a part of a late frame may be written, and how large it may be, so that it has gone
/// through the link before the next live frame is captured.
///
/// The link is taken for a line of the measured rate: what is written keeps it busy for bytes /
/// rate, at most for a second: the rate is an estimate, and the acknowledgements come. The next
/// live frame is expected one mean interval after the last, and earlier by twice the mean
/// deviation, at least by a tenth of the interval. A part that would not end before that is made
/// smaller or waits. So a live frame waits for late ones where rate or capture are other than they
/// were. What is in the link's queue beside that, as after an outage, the acknowledgements tell
/// (LinkRate::served_at() and is_overdue()).
///
/// A link that live frames fill to nine tenths has no such room. Where the path has much jitter it
/// may only seem to be so full, and it may seem so for good. So the smallest part goes whenever 32
/// times as many bytes have gone without one: on a full link a frame then waits for 512 bytes more,
/// which is 3 % of the stream. Knows no clock and no socket. Reentrant.
class BackfillPace {
 public:
  using Clock = std::chrono::steady_clock;
  using Time = Clock::time_point;
  using Seconds = std::chrono::duration<double>;

  /// A part is at most about as large as what the kernel may have unsent, and not so small that it
  /// is all headers.
  static constexpr std::size_t kMostBytes = 16U << 10;
  static constexpr std::size_t kLeastBytes = 512;
  /// After so many bytes without a part it is time for one, however full the link may be.
  static constexpr std::size_t kMostBetween = 32 * kLeastBytes;
  /// The rate in bytes a second as long as no live frame has shown it.
  static constexpr double kUnknownRate = 64U << 10;

  /// A live frame is ready to be sent.
  void on_captured(Time now);
  /// bytes_per_s: of the link, as measured; 0: not known. So in the following.
  void on_written(Time now, std::size_t bytes, double bytes_per_s);
  /// What was written last is a part of a late frame.
  void on_part_written() { bytes_since_part_ = 0; }

  struct Turn {
    std::size_t bytes = 0;  ///< 0: nothing may be written now
    Time again;             ///< then: ask again at this time
  };
  /// busy_until: what the acknowledgements say of the link, if that is later.
  Turn next(Time now, double bytes_per_s, Time busy_until = {}) const;

 private:
  Time captured_;         // the last one
  Seconds interval_{0};   // mean; 0: not known
  Seconds deviation_{0};  // mean, of the interval
  bool has_captured_ = false;
  Time busy_until_;
  std::size_t bytes_since_part_ = 0;
};

/// Brings what the record has to the server, beside the live stream: accounts of its sessions, and
/// the frames that it holds, in the time that live frames leave: docs/protocol.md. What a message
/// is written to, and when live has nothing to write, is the owner's matter. Thread-bound to
/// `main`.
class Backfill {
 public:
  using Time = BackfillPace::Time;

  /// Late bytes that the server has not acknowledged, beyond two frames.
  static constexpr std::size_t kMostUnacknowledged = 4U << 20;
  /// Accounts that the server has not acknowledged, except before a bye.
  static constexpr std::uint64_t kMostAccounts = 4;

  /// `record` must outlive it. wake: there may be something to write.
  Backfill(boost::asio::io_context& io, Record& record, std::function<void()> wake);

  /// As the server's welcome says. Not called: nothing is sent.
  void on_connected(bool takes_late, bool takes_accounts, std::uint32_t max_frame_bytes);
  void on_disconnected();
  /// The server has the late frames and accounts below `position`.
  void on_ack(const wire::Position& position);

  void on_captured(Time now) { pace_.on_captured(now); }
  /// Anything was written. bytes_per_s: of the link; 0: not known.
  void on_written(Time now, std::size_t bytes, double bytes_per_s) {
    pace_.on_written(now, bytes, bytes_per_s);
  }
  /// That was what take_part() returned.
  void on_part_written() { pace_.on_part_written(); }

  /// The next account, if one is to be told now; else empty. final: before a bye, whenever the last
  /// was told.
  std::optional<wire::Items> take_account(Time now, bool final = false);
  /// The next part of a late frame, if it may be written now: nothing live waits for the link, and
  /// no account. Else empty, and `wake` runs later if need be.
  /// busy_until: as BackfillPace::next() takes it.
  std::optional<wire::Items> take_part(Time now, double bytes_per_s, Time busy_until);

 private:
  static constexpr std::chrono::seconds kAccountInterval{1};

  struct Begun {
    std::uint64_t number = 0;
    KeptId id;
    std::size_t bytes = 0;
  };
  struct LastWord {
    std::uint64_t number = 0;
    std::string session_id;
  };

  bool begin_frame();
  void wake_at(Time time);

  Record& record_;
  const std::function<void()> wake_;
  boost::asio::steady_timer timer_;
  BackfillPace pace_;
  bool is_too_large_logged_ = false;
  // Of the connection:
  bool takes_late_ = false;
  bool takes_accounts_ = false;
  std::uint32_t max_frame_bytes_ = 0;      // 0: not known
  std::vector<std::uint8_t> late_record_;  // of the frame that is being sent; empty: none is
  std::size_t sent_ = 0;                   // of late_record_
  std::uint64_t next_late_ = 0;
  std::deque<Begun> begun_;  // not acknowledged, the oldest first
  std::size_t begun_bytes_ = 0;
  std::deque<wire::Account> accounts_;  // to be told
  Time account_time_{};                 // when there may be more
  std::uint64_t next_account_ = 0;
  std::uint64_t told_ = 0;           // accounts that are acknowledged
  std::deque<LastWord> last_words_;  // not acknowledged: of sessions that are settled then
};

}  // namespace orbbuf
