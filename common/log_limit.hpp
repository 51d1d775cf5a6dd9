// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace orbbuf {

/// Keeps what may happen with every frame from filling the log: the first time, and then no sooner
/// than `interval` after the last that was let through. Thread-bound.
class LogLimit {
 public:
  using Moment = std::chrono::steady_clock::time_point;

  explicit LogLimit(std::chrono::nanoseconds interval) : interval_(interval) {}

  bool lets_through(Moment now = std::chrono::steady_clock::now()) {
    if (now < next_) return false;
    next_ = now + interval_;
    return true;
  }

 private:
  std::chrono::nanoseconds interval_;
  Moment next_ = Moment::min();
};

}  // namespace orbbuf
