// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>

#include "daemon/net/tcp_progress.hpp"

namespace orbbuf {

/// Tells a stalled connection from a slow one by what its kernel says: something is outstanding, be
/// it but a probe of a full window, and the peer's kernel acknowledges nothing for `timeout`, or
/// for two round trips where that is longer. Knows no clock and no socket. Reentrant.
class StallWatch {
 public:
  using Time = std::chrono::steady_clock::time_point;

  explicit StallWatch(std::chrono::nanoseconds timeout) : timeout_(timeout) {}

  /// A new connection begins.
  void restart(Time now);
  /// What the kernel says of it `now`; nothing if it cannot tell, which counts as moving.
  void look(const std::optional<TcpProgress>& progress, Time now);

  /// How long, at the last look, nothing had moved that should have.
  std::chrono::nanoseconds still_for() const { return still_for_; }
  bool is_moving() const { return still_for_.count() == 0; }
  bool is_stalled() const { return still_for_ >= limit_; }

 private:
  const std::chrono::nanoseconds timeout_;
  std::chrono::nanoseconds limit_ = timeout_;
  std::chrono::nanoseconds still_for_{0};
  std::uint64_t acked_bytes_ = 0;  // when last seen to grow
  Time moved_time_;                // when that was
};

inline void StallWatch::restart(Time now) {
  acked_bytes_ = 0;
  moved_time_ = now;
  still_for_ = std::chrono::nanoseconds(0);
  limit_ = timeout_;
}

inline void StallWatch::look(const std::optional<TcpProgress>& progress, Time now) {
  if (!progress || !progress->is_waiting() || progress->acked_bytes != acked_bytes_) {
    restart(now);
    if (progress) acked_bytes_ = progress->acked_bytes;
    return;
  }
  still_for_ = now - moved_time_;
  limit_ = std::max<std::chrono::nanoseconds>(timeout_, 2 * progress->round_trip);
}

}  // namespace orbbuf
