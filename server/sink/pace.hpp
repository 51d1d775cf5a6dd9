// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <optional>

#include "common/frame.hpp"

namespace orbbuf {

/// Spreads the frames of one session that arrive in a burst, as after an outage: for readers that
/// keep the newest message only. Two frames are at least the camera's period apart, divided by
/// `speed`. The period is the step in capture time, divided by the step in sequence numbers, so
/// that frames which the policy dropped do not change it. Reentrant.
class Pace {
 public:
  using Clock = std::chrono::steady_clock;

  /// A camera that stood still, or a clock that was set, delays one frame by this at most.
  static constexpr std::chrono::nanoseconds kLongest = std::chrono::milliseconds{100};

  /// speed: > 0; above 1, since otherwise the frames after a burst stay late.
  explicit Pace(double speed) : speed_(speed) {}

  /// The earliest time at which `frame` may follow the last one.
  Clock::time_point due(const EncodedFrame& frame) const {
    if (!last_ || frame.sequence <= last_->sequence) return Clock::time_point::min();
    const auto frames = static_cast<double>(frame.sequence - last_->sequence);
    const auto step_ns = static_cast<double>(frame.capture_time_ns - last_->capture_time_ns);
    const std::chrono::duration<double, std::nano> spacing(
        std::clamp(step_ns / frames / speed_, 0.0, static_cast<double>(kLongest.count())));
    return last_->time + std::chrono::duration_cast<Clock::duration>(spacing);
  }

  void published(const EncodedFrame& frame, Clock::time_point now) {
    last_ = Last{frame.sequence, frame.capture_time_ns, now};
  }

 private:
  struct Last {
    Sequence sequence;
    std::int64_t capture_time_ns;
    Clock::time_point time;
  };

  const double speed_;
  std::optional<Last> last_;
};

}  // namespace orbbuf
