// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <limits>
#include <optional>

#include "common/drop_record.hpp"
#include "common/seconds.hpp"

namespace orbbuf {

/// What became of the frames that were captured in one second.
struct TimelineSecond {
  std::int64_t second = 0;  ///< by the robot's clock
  std::uint32_t delivered = 0;
  std::uint32_t dropped = 0;
  std::uint16_t similarity = kUnknownSimilarity;  ///< the smallest of the dropped
  std::uint32_t delay_ms = 0;  ///< the longest on the way; 0 is that of the session's fastest frame
  std::chrono::steady_clock::time_point changed{};
};

/// A time without a frame of a robot that had something to send.
struct Outage {
  std::chrono::nanoseconds begin{};  ///< by the robot's clock
  std::chrono::nanoseconds end{};
};

/// The last two minutes of a session, by the time of capture. Of the robot's clock it is known only
/// what the frames say: that of the frame that was fastest, lately, is taken for ours.
/// Memory: some 8 KB, whatever times the robot claims. Reentrant.
class Timeline {
 public:
  using Time = std::chrono::steady_clock::time_point;
  static constexpr std::int64_t kSeconds = 120;
  static constexpr std::size_t kOutages = 32;

  /// Anything came; `is_new` on a new connection.
  void on_heard(Time now, bool is_new);
  /// Frames in the order in which they came; after on_heard().
  void on_delivered(std::int64_t capture_time_ns, Time now);
  void on_dropped(const DropRecord& record, Time now);

  /// Oldest first; seconds of which nothing is known are missing.
  const std::deque<TimelineSecond>& seconds() const { return seconds_; }
  const std::deque<Outage>& outages() const { return outages_; }
  Time last_heard() const { return heard_; }
  /// The robot's clock, at our `time`; 0 if no frame has come.
  std::chrono::nanoseconds robot_time(Time time) const;
  /// Since the frame that was delivered last was captured. Nothing if none was.
  std::optional<std::chrono::nanoseconds> age(Time now) const;

 private:
  using Nanoseconds = std::chrono::nanoseconds;

  TimelineSecond* second_of(std::int64_t capture_time_ns, bool is_in_order);
  Nanoseconds note_offset(Nanoseconds offset, Time now);

  std::deque<TimelineSecond> seconds_;
  std::deque<Outage> outages_;
  std::optional<Nanoseconds> newest_;  // capture time
  Time heard_{};
  Time silent_since_{};  // the last but one time, if it was long before
  bool is_silence_over_ = false;
  bool is_after_connect_ = false;
  // Our clock less the robot's, at the least: of this minute with frames, and of the one before.
  static constexpr Nanoseconds kNone{std::numeric_limits<Nanoseconds::rep>::max()};
  Nanoseconds offset_ = kNone;
  Nanoseconds offset_before_ = kNone;
  Time minute_{};
};

}  // namespace orbbuf
