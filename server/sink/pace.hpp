// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>

#include "common/frame.hpp"

namespace orbbuf {

/// Spreads the frames of one session, or the messages of one of its topics, that arrive in a burst,
/// as after an outage: for readers that keep the newest few only. Two are at least their period
/// apart, divided by `speed`. The period is the step in time, divided by the step in numbers, so
/// that those which were dropped do not change it. Reentrant.
class Pace {
 public:
  using Clock = std::chrono::steady_clock;

  /// A camera that stood still, or a clock that was set, delays one frame by this at most.
  static constexpr std::chrono::nanoseconds kLongest = std::chrono::milliseconds{100};

  /// speed: > 0; above 1, since otherwise the frames after a burst stay late. longest: between two.
  /// ahead: so much earlier one may come, so that one that came late delays no other.
  explicit Pace(double speed, std::chrono::nanoseconds longest = kLongest,
                std::chrono::nanoseconds ahead = {})
      : speed_(speed), longest_(longest), ahead_(ahead) {}

  double speed() const { return speed_; }

  /// The earliest time at which that one may follow the last one. haste: so many times faster than
  /// `speed`.
  Clock::time_point due(Sequence number, std::int64_t time_ns, double haste = 1) const {
    if (!last_ || number <= last_->number) return Clock::time_point::min();
    return last_->due + spacing(number, time_ns, haste) - ahead_;
  }

  void published(Sequence number, std::int64_t time_ns, Clock::time_point now, double haste = 1) {
    const bool is_next = last_ && number > last_->number;
    const auto due = is_next ? last_->due + spacing(number, time_ns, haste) : now;
    last_ = Last{number, time_ns, std::clamp(due, now, now + ahead_)};
  }

 private:
  struct Last {
    Sequence number;
    std::int64_t time_ns;
    Clock::time_point due;  // `ahead_` after it was published, at most
  };

  Clock::duration spacing(Sequence number, std::int64_t time_ns, double haste) const {
    const auto steps = static_cast<double>(number - last_->number);
    const auto step_ns = static_cast<double>(time_ns - last_->time_ns);
    const std::chrono::duration<double, std::nano> spacing(
        std::clamp(step_ns / steps / speed_, 0.0, static_cast<double>(longest_.count())));
    return std::chrono::duration_cast<Clock::duration>(spacing / haste);
  }

  double speed_;
  std::chrono::nanoseconds longest_;
  std::chrono::nanoseconds ahead_;
  std::optional<Last> last_;
};

}  // namespace orbbuf
