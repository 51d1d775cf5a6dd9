// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace orbbuf {

/// Limits a message that could be logged with every frame: lets the first one through, and then
/// one per `interval`. Thread-bound.
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
