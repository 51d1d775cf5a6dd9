// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/camera_clock.hpp"

#include <algorithm>
#include <limits>

namespace orbbuf {
namespace {

constexpr std::int64_t kSleepNs = 1'000'000'000;
constexpr std::uint32_t kLargestGap = 1U << 31;  // beyond that, it is a step back

template <class Clock>
std::int64_t now_ns() {
  using std::chrono::nanoseconds;
  return std::chrono::duration_cast<nanoseconds>(Clock::now().time_since_epoch()).count();
}

}  // namespace

ClockPair read_clocks() {
  ClockPair closest;
  std::int64_t least_ns = std::numeric_limits<std::int64_t>::max();
  for (int i = 0; i < 5; ++i) {
    const auto before_ns = now_ns<std::chrono::steady_clock>();
    const auto utc_ns = now_ns<std::chrono::system_clock>();
    const auto taken_ns = now_ns<std::chrono::steady_clock>() - before_ns;
    if (taken_ns >= least_ns) continue;
    least_ns = taken_ns;
    closest = {before_ns + taken_ns / 2, utc_ns};
  }
  return closest;
}

bool CaptureClock::start(const ClockPair& now) {
  const std::int64_t offset_ns = now.utc_ns - now.monotonic_ns;
  if (is_started_ && offset_ns <= offset_ns_ + kSleepNs) return false;
  offset_ns_ = offset_ns;
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
