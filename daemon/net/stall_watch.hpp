// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>

#include "common/wire.hpp"
#include "daemon/net/tcp_progress.hpp"

namespace orbbuf {

/// Finds a server whose kernel has taken all that was written, while the server itself says nothing
/// about the frames or other items in it for `timeout`. A slow link is none, since bytes are then
/// outstanding. Knows no clock and no socket. Reentrant.
class AckWatch {
 public:
  using Time = std::chrono::steady_clock::time_point;

  explicit AckWatch(std::chrono::nanoseconds timeout) : timeout_(timeout) {}

  /// A new connection begins.
  void restart() {
    owed_ = acknowledged_ = {};
    taken_.reset();
    silent_for_ = std::chrono::nanoseconds(0);
  }

  /// This item of a stream is written to it: a frame, by its sequence number, or another.
  void on_item(wire::StreamId stream, std::uint64_t number) { owed_[stream] = number + 1; }

  /// Any word of it counts, even one that repeats the last.
  void on_ack(const wire::Ack& ack) {
    acknowledged_ = ack.position;
    taken_.reset();
  }

  /// What the kernel says of it `now`; nothing if it cannot tell, which counts as taken.
  void look(const std::optional<TcpProgress>& progress, Time now) {
    const bool is_outstanding = progress && (progress->is_waiting() || progress->unsent_bytes > 0);
    if (!is_owed()) {
      taken_.reset();
    } else if (!taken_ && !is_outstanding) {
      taken_ = now;
    }
    silent_for_ = taken_ ? now - *taken_ : std::chrono::nanoseconds(0);
  }

  /// Its word may be on its way: the silence begins `now`.
  void excuse(Time now) {
    if (taken_) taken_ = now;
    silent_for_ = {};
  }

  bool is_owed() const {
    for (wire::StreamId id = 0; id < wire::kMostStreams; ++id) {
      if (owed_[id] > acknowledged_[id]) return true;
    }
    return false;
  }
  /// How long, at the last look, the server had owed an answer.
  std::chrono::nanoseconds silent_for() const { return silent_for_; }
  bool is_silent() const { return silent_for_ >= timeout_; }

 private:
  const std::chrono::nanoseconds timeout_;
  wire::Position owed_;          // what is below it is to be acknowledged
  wire::Position acknowledged_;  // what is below it is
  std::optional<Time> taken_;    // since then the kernel has what is owed, and no word came
  std::chrono::nanoseconds silent_for_{0};
};

/// Tells a stalled connection from a slow one by what its kernel says: something is outstanding, be
/// it but a probe of a full window, and the peer's kernel acknowledges nothing for `timeout`, or
/// for two round trips where that is longer. Knows no clock and no socket. Reentrant.
class StallWatch {
 public:
  using Time = std::chrono::steady_clock::time_point;

  explicit StallWatch(std::chrono::nanoseconds timeout) : timeout_(timeout) {}

  /// A new connection begins.
  void restart(Time now) {
    acked_bytes_ = 0;
    moved_time_ = now;
    still_for_ = std::chrono::nanoseconds(0);
    limit_ = timeout_;
  }

  /// What the kernel says of it `now`; nothing if it cannot tell, which counts as moving.
  void look(const std::optional<TcpProgress>& progress, Time now) {
    if (!progress || !progress->is_waiting() || progress->acked_bytes != acked_bytes_) {
      restart(now);
      if (progress) acked_bytes_ = progress->acked_bytes;
      return;
    }
    still_for_ = now - moved_time_;
    limit_ = std::max<std::chrono::nanoseconds>(timeout_, 2 * progress->round_trip);
  }

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

}  // namespace orbbuf
