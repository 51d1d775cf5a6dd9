// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <deque>
#include <optional>

#include "common/frame.hpp"

namespace orbbuf {

/// How fast the link and the server take frames, measured by when the server says that it has
/// received them, and how much may be on its way.
///
/// Frames queue for the link, so the service of a frame begins when the one before it has been
/// received, or when it was written, whichever is later; the path's own round trip is no
/// service, nor what frames that come to an idle link usually need beyond it: jitter, the sleep of
/// a Wi-Fi card, other streams in the same queue. The rate is what was served over how long that
/// took, of about the last 16 frames and the last second of service. A server slower than the link
/// counts like a slow link: its answers come later.
///
/// A link that was idle may pass up to 32 kB at once. A frame that comes then shows only two bounds
/// of the rate, with and without those bytes. While frames follow each other, a rate between the
/// bounds stays. After a return the rate is so rather too low than too high, which is what the
/// planner needs (docs/design.md, "The window and the rate").
///
/// Knows no clock and no socket. Reentrant.
class LinkRate {
 public:
  using Time = std::chrono::steady_clock::time_point;

  void on_written(Time now, Sequence sequence, std::size_t bytes);
  /// The server has every frame below `next`. round_trip: the path's shortest.
  void on_received(Time now, Sequence next, std::chrono::nanoseconds round_trip);
  /// The connection broke: what is on its way will not be answered, and tells nothing. The rate
  /// is now at most three times what the stream carried, and counts as one frame. A link fades
  /// before it breaks: if it has become slow within the last seconds, the rate is that of before.
  void on_lost();

  /// 0 until a frame has been received. An outage does not change it: one observation counts
  /// for at most four times as long as expected. The second one in a row that takes at least twice
  /// as long as expected is the new rate.
  double bytes_per_s() const { return sums_.service_s > 0 ? sums_.bytes / sums_.service_s : 0; }
  /// Half of that while the link may have become slow: the last observation, or a frame on its
  /// way, takes more than twice as long as expected.
  double bytes_per_s(Time now, std::chrono::nanoseconds round_trip) const;

  /// Whether one more frame like the last one may be written. What is written is beyond the
  /// planner, and may be more than the link's queue holds, so that is little: two frames, or what
  /// link and server take in two round trips and 30 ms. One frame while the link may have become
  /// slow; and one now and then if the path usually takes more than 20 ms longer than its round
  /// trip, to measure that.
  bool has_room(Time now, std::chrono::nanoseconds round_trip) const;

  /// When the link has served what is on its way, as far as the acknowledgements tell; in the past
  /// if nothing is.
  Time served_at(std::chrono::nanoseconds round_trip) const;
  /// A frame should have been received by now: something else keeps the link busy, or it is gone.
  bool is_overdue(Time now, std::chrono::nanoseconds round_trip) const;

 private:
  struct Written {
    Sequence sequence = 0;
    std::size_t bytes = 0;
    Time time;
  };
  /// What was received together.
  struct Observation {
    double bytes = 0;
    double service_s = 0;
    double idle_s = 0;  // of the link before that
  };

  /// The sums of what was seen.
  struct Sums {
    double bytes = 0;
    double service_s = 0;
    double passed_s = 0;  // service, and what the link was idle before it
  };

  void begin_connection(double round_trip_s);
  void learn_path(Time now, const Written& frame, std::chrono::nanoseconds round_trip);
  /// With what it usually takes longer.
  std::chrono::nanoseconds path(std::chrono::nanoseconds round_trip) const {
    return round_trip + usual_;
  }
  void observe(Observation seen);
  void become_slow(const Observation& before, const Observation& seen);
  static bool is_slow(double service_s, double expected_s);
  bool is_doubtful(Time now, std::chrono::nanoseconds round_trip) const;
  void add(const Observation& seen, double weight);
  double bytes_on_their_way() const;
  Time served_at(std::size_t frames, std::chrono::nanoseconds round_trip) const;

  std::deque<Written> on_their_way_;
  Time received_time_;                 // of the last frame that was
  Sums sums_;                          // of which the old part fades
  std::optional<Observation> slow_;    // the last one, if it was
  double tokens_ = 0;                  // bytes that the link may pass now without any service
  double slow_start_s_ = 0;            // that the connection may still need
  bool is_new_ = true;                 // no frame of this connection was received
  std::optional<Time> begun_;          // the first frame of this connection was written
  std::deque<double> beyond_s_;        // of the last ones to an idle link: beyond trip and service
  std::chrono::nanoseconds usual_{0};  // of these
  Time learn_time_;                    // the last one to an idle link was received
  std::optional<Sums> before_slow_;    // a while ago at most
  double slow_for_s_ = 0;              // since then
};

}  // namespace orbbuf
