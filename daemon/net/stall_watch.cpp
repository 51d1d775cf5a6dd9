// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/stall_watch.hpp"

#include <algorithm>

namespace orbbuf {

void StallWatch::restart(Time now) {
  acked_bytes_ = 0;
  moved_time_ = now;
  still_for_ = std::chrono::nanoseconds(0);
  limit_ = timeout_;
}

void StallWatch::look(const std::optional<TcpProgress>& progress, Time now) {
  if (!progress || !progress->is_waiting() || progress->acked_bytes != acked_bytes_) {
    restart(now);
    if (progress) acked_bytes_ = progress->acked_bytes;
    return;
  }
  still_for_ = now - moved_time_;
  limit_ = std::max<std::chrono::nanoseconds>(timeout_, 2 * progress->round_trip);
}

}  // namespace orbbuf
