// SPDX-License-Identifier: Apache-2.0
#include "daemon/clock_watch.hpp"

#include "common/log.hpp"
#include "common/seconds.hpp"

namespace orbbuf {

void ClockWatch::look(const SystemClockReading& now) {
  if (!last_) {
    if (!now.is_synchronised) {
      log_warn(
          "no NTP client keeps this machine's clock: the capture times are as wrong as the clock");
    }
  } else {
    const std::chrono::nanoseconds step =
        now.wall - last_->wall - (now.since_boot - last_->since_boot);
    if (std::chrono::abs(step) >= kStep) {
      stepped_ += step;
      log_warn(
          "the clock was set by {:+.3f} s; the capture times of this session keep the clock that "
          "it began with: add {:+.3f} s",
          to_seconds(step), to_seconds(stepped_));
    }
    if (now.is_synchronised && !last_->is_synchronised) {
      log_info("an NTP client keeps this machine's clock now");
    }
  }
  last_ = now;
}

}  // namespace orbbuf
