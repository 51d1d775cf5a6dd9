// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>

#include "common/frame.hpp"
#include "common/wire.hpp"
#include "daemon/net/tcp_progress.hpp"

namespace orbbuf {

/// Finds a server whose kernel has taken all that was written, while the server itself says nothing
/// about the frames in it for `timeout`. A slow link is none, since bytes are then outstanding.
/// Knows no clock and no socket. Reentrant.
class AckWatch {
 public:
  using Time = std::chrono::steady_clock::time_point;

  explicit AckWatch(std::chrono::nanoseconds timeout) : timeout_(timeout) {}

  /// A new connection begins.
  void restart();
  /// A frame is written to it.
  void on_frame(Sequence sequence) { owed_ = sequence + 1; }
  void on_ack(const wire::Ack& ack);
  /// What the kernel says of it `now`; nothing if it cannot tell, which counts as taken.
  void look(const std::optional<TcpProgress>& progress, Time now);

  /// How long, at the last look, the server had owed an answer.
  std::chrono::nanoseconds silent_for() const { return silent_for_; }
  bool is_silent() const { return silent_for_ >= timeout_; }

 private:
  const std::chrono::nanoseconds timeout_;
  Sequence owed_ = 0;          // frames below it are to be acknowledged
  Sequence acknowledged_ = 0;  // those below it are
  std::optional<Time> taken_;  // since then the kernel has what is owed, and no word came
  std::chrono::nanoseconds silent_for_{0};
};

inline void AckWatch::restart() {
  owed_ = acknowledged_ = 0;
  taken_.reset();
  silent_for_ = std::chrono::nanoseconds(0);
}

/// Any word of it counts, even one that repeats the last.
inline void AckWatch::on_ack(const wire::Ack& ack) {
  acknowledged_ = ack.position[wire::kFrames];
  taken_.reset();
}

inline void AckWatch::look(const std::optional<TcpProgress>& progress, Time now) {
  const bool is_outstanding = progress && (progress->is_waiting() || progress->unsent_bytes > 0);
  if (owed_ <= acknowledged_) {
    taken_.reset();
  } else if (!taken_ && !is_outstanding) {
    taken_ = now;
  }
  silent_for_ = taken_ ? now - *taken_ : std::chrono::nanoseconds(0);
}

}  // namespace orbbuf
