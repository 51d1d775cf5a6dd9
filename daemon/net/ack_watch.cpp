// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/ack_watch.hpp"

namespace orbbuf {

void AckWatch::restart() {
  owed_ = acknowledged_ = 0;
  taken_.reset();
  silent_for_ = std::chrono::nanoseconds(0);
}

/// Any word of it counts, even one that repeats the last.
void AckWatch::on_ack(const wire::Ack& ack) {
  acknowledged_ = ack.position[wire::kFrames];
  taken_.reset();
}

void AckWatch::look(const std::optional<TcpProgress>& progress, Time now) {
  const bool is_outstanding = progress && (progress->is_waiting() || progress->unsent_bytes > 0);
  if (owed_ <= acknowledged_) {
    taken_.reset();
  } else if (!taken_ && !is_outstanding) {
    taken_ = now;
  }
  silent_for_ = taken_ ? now - *taken_ : std::chrono::nanoseconds(0);
}

}  // namespace orbbuf
