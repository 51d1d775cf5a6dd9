// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>

namespace orbbuf {

/// So many a second: counted over a second, and the result holds for the next.
class EventRate {
 public:
  using Clock = std::chrono::steady_clock;
  using Time = Clock::time_point;

  void count(std::uint64_t events, Time now) {
    if (now - since_ >= kCounting) {
      last_ = per_second(now);
      since_ = now;
      counted_ = 0;
    }
    counted_ += events;
  }
  double per_second(Time now) const {
    const std::chrono::duration<double> time = now - since_;
    return time < kCounting ? last_ : static_cast<double>(counted_) / time.count();
  }

 private:
  static constexpr std::chrono::seconds kCounting{1};

  Time since_{};
  std::uint64_t counted_ = 0;
  double last_ = 0;
};

}  // namespace orbbuf
