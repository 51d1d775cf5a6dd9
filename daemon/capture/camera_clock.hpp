// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace orbbuf {

/// Clocks at one moment: the monotonic one that drivers stamp buffers with, which is Linux's
/// steady_clock and stands still while the machine sleeps, UTC, and for how long it has slept since
/// it was booted.
struct ClockReading {
  std::int64_t monotonic_ns = 0;
  std::int64_t utc_ns = 0;
  std::int64_t asleep_ns = 0;
};

/// Within a few microseconds of each other; takes about one.
ClockReading read_clocks();

/// Capture times in UTC from a driver's monotonic time stamps, by an offset that is taken once and
/// then grows only by the time that the machine sleeps, so that steps of the system's clock do not
/// reach into the images' times. Times strictly increase. Thread-bound.
class CaptureClock {
 public:
  /// Before each frame's time is asked for. True if that changed the offset: at the first reading,
  /// and where the machine has slept since the one before. A frame that was captured before the
  /// sleep and read after it gets the time of a frame from after it.
  bool follow(const ClockReading& now);

  std::int64_t offset_ns() const { return offset_ns_; }

  /// The capture time of a buffer stamped `stamp_ns` that is read at `now_ns` (both monotonic). A
  /// stamp that cannot be (none at all: 0, or later than now) is replaced by now.
  std::int64_t utc_ns(std::int64_t stamp_ns, std::int64_t now_ns);

 private:
  std::int64_t offset_ns_ = 0;
  std::int64_t asleep_ns_ = 0;
  std::int64_t last_utc_ns_ = 0;
  bool is_started_ = false;
};

/// Counts the frames that are missing in a driver's sequence numbers. Thread-bound.
class GapCounter {
 public:
  /// A stream starts, whose numbers begin anywhere.
  void start() { is_started_ = false; }

  /// How many are missing before the buffer of this number, which wraps around. A driver that does
  /// not count, or begins again, misses nothing.
  std::uint32_t missed_before(std::uint32_t sequence);

 private:
  std::uint32_t last_ = 0;
  bool is_started_ = false;
};

}  // namespace orbbuf
