// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/format.h>

#include <chrono>
#include <cstdint>
#include <optional>

#include "common/log.hpp"
#include "common/seconds.hpp"
#include "common/system_clock.hpp"

namespace orbbuf {

/// Logs what the system's clock does to the capture times. A session keeps the clock that it began
/// with (CaptureClock), so a clock that is set right later makes its times wrong by as much as the
/// log says, and as stepped() tells the server. Has no clock of its own; thread-bound.
class ClockWatch {
 public:
  /// A step that the log names; NTP clients slew what is less.
  static constexpr std::chrono::milliseconds kStep{500};

  void look(const SystemClockReading& now) {
    if (!last_) {
      if (!now.is_synchronised) {
        log_warn(
            "no NTP client keeps this machine's clock: the capture times are as wrong as the "
            "clock");
      }
    } else {
      const std::chrono::nanoseconds step =
          now.wall - last_->wall - (now.since_boot - last_->since_boot);
      if (std::chrono::abs(step) >= kStep) {
        stepped_ += step;
        log_warn("the clock was set by {:+.3f} s{}", to_seconds(step),
                 has_begun_ ? fmt::format("; the capture times of this session keep the clock that "
                                          "it began with: add {:+.3f} s",
                                          to_seconds(stepped_))
                            : "");
      }
      if (now.is_synchronised && !last_->is_synchronised) {
        log_info("an NTP client keeps this machine's clock now");
      }
    }
    last_ = now;
  }

  /// The capture times begin with the clock as it is now.
  void begin_session() {
    stepped_ = {};
    has_begun_ = true;
  }

  /// By how much the clock was set since then, in all: to be added to the capture times.
  std::chrono::nanoseconds stepped() const { return stepped_; }

  /// The time of a sample, in ns, that was stamped by the system's clock before the last look, on
  /// the clock of the capture times. One that was stamped before the clock was set back is of now;
  /// a driver's clock may be a little ahead.
  std::int64_t session_time(std::int64_t time_ns) const {
    if (stepped_ == stepped_.zero()) return time_ns;
    const std::chrono::nanoseconds now = last_->wall.time_since_epoch();
    const bool is_of_before = time_ns > (now + kStep / 2).count();
    return (is_of_before ? now.count() : time_ns) - stepped_.count();
  }

 private:
  std::optional<SystemClockReading> last_;
  std::chrono::nanoseconds stepped_{0};
  bool has_begun_ = false;
};

}  // namespace orbbuf
