// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>

#include "common/frame.hpp"

namespace orbbuf {

/// How fast the link and the server take frames, measured by the server's acknowledgements.
///
/// A frame is served from the acknowledgement of the frame before it to its own. If the link was
/// idle, its service begins when the server could first have acknowledged an empty frame: one round
/// trip after its write began. Frames that one acknowledgement covers are one observation. The rate
/// is the bytes served over the time of service, both sums forgotten exponentially: over 1 s of
/// service or 50 observations, whichever passes first. Time without frames does not count, so the
/// rate also holds for a link that is faster than the camera.
///
/// An observation counts as at most 4 times the time that the present rate predicts, so that an
/// outage hardly changes the rate. The limit doubles with each observation in a row that reaches
/// it: the rate follows a link that stays slow within seconds. A new connection keeps the rate.
/// In its first ten round trips, while TCP looks for the link's rate, an observation cannot lower
/// the rate.
///
/// Knows no clock and no socket. Reentrant.
class LinkRate {
 public:
  using Time = std::chrono::steady_clock::time_point;

  /// A new connection begins. Frames in flight on the one before are forgotten.
  void on_connected(Time now);
  /// The write of a frame of so many bytes begins. `sequence` must exceed those before.
  void on_write(Sequence sequence, std::size_t bytes, Time now);
  /// The server has every frame below `next`. `min_round_trip`: the shortest one seen on this
  /// connection; 0 if unknown.
  void on_acknowledged(Sequence next, Time now, std::chrono::nanoseconds min_round_trip);

  /// 0: unknown, no frame was acknowledged yet.
  double bytes_per_s() const { return seconds_ > 0 ? bytes_ / seconds_ : 0; }

  /// Written to this connection, not yet acknowledged.
  std::size_t frames_in_flight() const { return in_flight_.size(); }
  std::uint64_t bytes_in_flight() const { return bytes_in_flight_; }

 private:
  static constexpr double kLimit = 4;

  struct Written {
    Sequence sequence;
    std::size_t bytes;
    Time time;
  };

  void observe(double bytes, std::chrono::duration<double> service, bool is_starting);

  std::deque<Written> in_flight_;
  std::uint64_t bytes_in_flight_ = 0;
  Time connected_time_;
  Time acknowledged_time_;  // of the last acknowledgement, or when the connection began
  double bytes_ = 0;        // served; both sums are forgotten exponentially
  double seconds_ = 0;      // of service
  double limit_ = kLimit;   // of the next observation, in times of what the rate predicts
};

}  // namespace orbbuf
