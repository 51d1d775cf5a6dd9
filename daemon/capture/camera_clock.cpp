// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/camera_clock.hpp"

#include <algorithm>
#include <ctime>
#include <limits>

namespace orbbuf {
namespace {

constexpr std::int64_t kShortestSleepNs = 10'000'000;  // less is how far off a reading may be
constexpr std::uint32_t kLargestGap = 1U << 31;        // beyond that, it is a step back

std::int64_t now_ns(clockid_t clock) {
  timespec now{};
  ::clock_gettime(clock, &now);
  return now.tv_sec * 1'000'000'000LL + now.tv_nsec;
}

}  // namespace

ClockReading read_clocks() {
  ClockReading closest;
  std::int64_t least_ns = std::numeric_limits<std::int64_t>::max();
  for (int i = 0; i < 5; ++i) {
    const auto before_ns = now_ns(CLOCK_MONOTONIC);
    const auto utc_ns = now_ns(CLOCK_REALTIME);
    const auto since_boot_ns = now_ns(CLOCK_BOOTTIME);
    const auto taken_ns = now_ns(CLOCK_MONOTONIC) - before_ns;
    if (taken_ns >= least_ns) continue;
    least_ns = taken_ns;
    const auto middle_ns = before_ns + taken_ns / 2;
    closest = {middle_ns, utc_ns, since_boot_ns - middle_ns};
  }
  return closest;
}

bool CaptureClock::follow(const ClockReading& now) {
  const std::int64_t slept_ns = now.asleep_ns - asleep_ns_;
  if (is_started_ && slept_ns < kShortestSleepNs) return false;
  offset_ns_ = is_started_ ? offset_ns_ + slept_ns : now.utc_ns - now.monotonic_ns;
  asleep_ns_ = now.asleep_ns;
  is_started_ = true;
  return true;
}

std::int64_t CaptureClock::utc_ns(std::int64_t stamp_ns, std::int64_t now_ns) {
  const bool is_possible = stamp_ns > 0 && stamp_ns <= now_ns;
  const std::int64_t utc_ns = (is_possible ? stamp_ns : now_ns) + offset_ns_;
  last_utc_ns_ = std::max(utc_ns, last_utc_ns_ + 1);
  return last_utc_ns_;
}

std::uint32_t GapCounter::missed_before(std::uint32_t sequence) {
  const std::uint32_t step = is_started_ ? sequence - last_ : 1;
  is_started_ = true;
  last_ = sequence;
  return step == 0 || step >= kLargestGap ? 0 : step - 1;
}

}  // namespace orbbuf
