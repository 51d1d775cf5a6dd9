// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/timex.h>

#include <chrono>
#include <cstdint>
#include <ctime>

namespace orbbuf {

struct SystemClockReading {
  std::chrono::system_clock::time_point wall;
  std::chrono::nanoseconds since_boot{0};  ///< by the clock that is never set; sleep counts
  bool is_synchronised = false;            ///< the kernel says so: an NTP client keeps the clock
};

inline std::int64_t system_time_ns() {
  return std::chrono::nanoseconds(std::chrono::system_clock::now().time_since_epoch()).count();
}

inline SystemClockReading read_system_clock() {
  timespec since_boot{};
  ::clock_gettime(CLOCK_BOOTTIME, &since_boot);
  timex kernel{};
  const bool is_synchronised = ::adjtimex(&kernel) != TIME_ERROR;
  return {std::chrono::system_clock::now(),
          std::chrono::seconds(since_boot.tv_sec) + std::chrono::nanoseconds(since_boot.tv_nsec),
          is_synchronised};
}

}  // namespace orbbuf
