// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>

#include "common/system_clock.hpp"

namespace orbbuf {

/// Decides whether a recording's age can be trusted, so that a clock that is set wrong removes
/// nothing. A clock that an NTP client keeps is trusted. Any other is not trusted for kQuarantine
/// after it has jumped: by more than kMostStep between two readings, or by more than kMostGap
/// between the last write before the first reading and that reading, as after a boot with a wrong
/// clock. chrony's `maxchange` is the model. Has no clock of its own; thread-bound.
class ClockTrust {
 public:
  static constexpr std::chrono::hours kMostGap{7 * 24};
  static constexpr std::chrono::hours kMostStep{1};
  static constexpr std::chrono::hours kQuarantine{24};

  /// last_write: of the newest recording.
  bool trusts(const SystemClockReading& now, std::chrono::system_clock::time_point last_write);

 private:
  std::optional<SystemClockReading> last_;
  std::chrono::nanoseconds quarantine_end_{0};  // since boot
};

inline bool ClockTrust::trusts(const SystemClockReading& now,
                               std::chrono::system_clock::time_point last_write) {
  const bool has_jumped = last_ ? std::chrono::abs(now.wall - last_->wall -
                                                   (now.since_boot - last_->since_boot)) > kMostStep
                                : now.wall - last_write > kMostGap;
  last_ = now;
  if (now.is_synchronised) {
    quarantine_end_ = {};
  } else if (has_jumped) {
    quarantine_end_ = now.since_boot + kQuarantine;
  }
  return now.since_boot >= quarantine_end_;
}

}  // namespace orbbuf
