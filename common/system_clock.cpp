// SPDX-License-Identifier: Apache-2.0
#include "common/system_clock.hpp"

#include <sys/timex.h>

#include <ctime>

namespace orbbuf {

SystemClockReading read_system_clock() {
  timespec since_boot{};
  ::clock_gettime(CLOCK_BOOTTIME, &since_boot);
  timex kernel{};
  const bool is_synchronised = ::adjtimex(&kernel) != TIME_ERROR;
  return {std::chrono::system_clock::now(),
          std::chrono::seconds(since_boot.tv_sec) + std::chrono::nanoseconds(since_boot.tv_nsec),
          is_synchronised};
}

}  // namespace orbbuf
