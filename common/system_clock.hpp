// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace orbbuf {

struct SystemClockReading {
  std::chrono::system_clock::time_point wall;
  std::chrono::nanoseconds since_boot{0};  ///< by the clock that is never set; sleep counts
  bool is_synchronised = false;            ///< the kernel says so: an NTP client keeps the clock
};

SystemClockReading read_system_clock();

}  // namespace orbbuf
