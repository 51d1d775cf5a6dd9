// SPDX-License-Identifier: Apache-2.0
#include "server/retention/clock_trust.hpp"

namespace orbbuf {

bool ClockTrust::trusts(const SystemClockReading& now,
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
