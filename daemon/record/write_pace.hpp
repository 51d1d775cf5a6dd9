// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

namespace orbbuf {

/// Limits what is written to a disk to so many bytes a second on average: a write may begin while
/// less than one second's worth is ahead of that rate. Reentrant.
class WritePace {
 public:
  using Clock = std::chrono::steady_clock;

  /// bytes_per_s: 0 for no limit.
  explicit WritePace(std::uint64_t bytes_per_s) : bytes_per_s_(static_cast<double>(bytes_per_s)) {}

  /// When the next write may begin; not after `now` if it may at once.
  Clock::time_point next() const { return paid_at_ - kBurst; }
  void spend(std::uint64_t bytes, Clock::time_point now) {
    if (bytes_per_s_ == 0) return;
    const std::chrono::duration<double> time(static_cast<double>(bytes) / bytes_per_s_);
    paid_at_ = std::max(paid_at_, now) + std::chrono::ceil<Clock::duration>(time);
  }

 private:
  static constexpr std::chrono::seconds kBurst{1};

  const double bytes_per_s_;
  Clock::time_point paid_at_{};  // when the rate has covered all that was written
};

}  // namespace orbbuf
