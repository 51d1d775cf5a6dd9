// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>

namespace orbbuf {

/// Says when a part of a late frame may be written, and how large it may be, so that it has gone
/// through the link before the next live frame is captured.
///
/// The link is taken for a line of the measured rate: what is written keeps it busy for bytes /
/// rate. The next live frame is expected one mean interval after the last, and earlier by twice the
/// mean deviation, at least by a tenth of the interval. A part that would not end before that is
/// made smaller or waits. So a live frame waits for late ones only where rate or capture are other
/// than they were, and a link that live frames fill to nine tenths carries no late ones.
/// What is in the link's queue beside that, as after an outage, the acknowledgements tell
/// (LinkRate::served_at() and is_overdue()).
/// Knows no clock and no socket. Reentrant.
class BackfillPace {
 public:
  using Clock = std::chrono::steady_clock;
  using Time = Clock::time_point;
  using Seconds = std::chrono::duration<double>;

  /// A part is at most about as large as what the kernel may have unsent, and not so small that it
  /// is all headers.
  static constexpr std::size_t kMostBytes = 16U << 10;
  static constexpr std::size_t kLeastBytes = 512;
  /// The rate in bytes a second as long as no live frame has shown it.
  static constexpr double kUnknownRate = 64U << 10;

  /// A live frame is ready to be sent.
  void on_captured(Time now);
  /// bytes_per_s: of the link, as measured; 0: not known. So in the following.
  void on_written(Time now, std::size_t bytes, double bytes_per_s);

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
};

}  // namespace orbbuf
