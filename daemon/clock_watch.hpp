// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>

#include "common/system_clock.hpp"

namespace orbbuf {

/// Logs what the system's clock does to the capture times. A session keeps the clock that it began
/// with (CaptureClock), so a clock that is set right later makes its times wrong by as much as the
/// log says, and as stepped() tells the server. Has no clock of its own; thread-bound.
class ClockWatch {
 public:
  /// A step that the log names; NTP clients slew what is less.
  static constexpr std::chrono::milliseconds kStep{500};

  void look(const SystemClockReading& now);

  /// By how much the clock was set since the first look, in all: to be added to the capture times.
  std::chrono::nanoseconds stepped() const { return stepped_; }

 private:
  std::optional<SystemClockReading> last_;
  std::chrono::nanoseconds stepped_{0};
};

}  // namespace orbbuf
