// SPDX-License-Identifier: Apache-2.0
#include "server/retention/clock_trust.hpp"

#include <sys/timex.h>

#include <ctime>

namespace orbbuf {

ClockReading read_clock() {
  timespec since_boot{};
  ::clock_gettime(CLOCK_BOOTTIME, &since_boot);
  timex kernel{};
  const bool is_synchronised = ::adjtimex(&kernel) != TIME_ERROR;
  return {std::chrono::system_clock::now(),
          std::chrono::seconds(since_boot.tv_sec) + std::chrono::nanoseconds(since_boot.tv_nsec),
          is_synchronised};
}

bool ClockTrust::trusts(const ClockReading& now, std::chrono::system_clock::time_point last_write) {
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
