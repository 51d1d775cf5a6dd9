// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <random>

namespace orbbuf {

/// How large the segments of the next connection may be, on a path that may lose large packets
/// without a word (an MTU black hole): small messages arrive there, so that the server welcomes the
/// robot, and no frame ever does. After two connections in a row that stalled before a segment of
/// full size was acknowledged, segments are of 1200 bytes; after three, of 536. Reentrant.
class SegmentSize {
 public:
  /// A connection was welcome, when its server had acknowledged so many bytes.
  void on_welcome(std::uint64_t acked_bytes) { acked_at_welcome_ = acked_bytes; }
  /// That connection stalled.
  void on_stall(std::uint64_t acked_bytes) {
    if (acked_bytes - acked_at_welcome_ < kSmall) return on_nothing_large();
    if (failures_ < kPatience) failures_ = 0;
  }
  /// A connection ended in the middle of the TLS handshake, whose certificates are large.
  void on_nothing_large() { ++failures_; }
  /// The path may be another.
  void reset() { failures_ = 0; }

  /// In bytes; 0: as the interface has it.
  int limit() const { return failures_ < kPatience ? 0 : failures_ == kPatience ? kSmall : kLeast; }

 private:
  static constexpr int kPatience = 2;  // an outage may begin just after a welcome
  static constexpr int kSmall = 1200;
  static constexpr int kLeast = 536;

  std::uint64_t acked_at_welcome_ = 0;
  int failures_ = 0;
};

/// When to begin the next attempt to connect: every `link.attempt_interval`, plus up to 30 % at
/// random, so that many robots behind one router do not return at the same moment. Longer intervals
/// apply to
///   - a long round trip, so that each of `at_once` attempts can wait for two of it;
///   - a long outage: a 600th of it so far, at most 1 s (longer than a minute, by default);
///   - a server that refuses the robot: twice the interval after each refusal, at most 10 s.
/// Knows no clock and no socket. Reentrant.
class AttemptPace {
 public:
  using Time = std::chrono::steady_clock::time_point;
  using Duration = std::chrono::nanoseconds;

  /// at_once: how many attempts may be in progress, at least 2.
  AttemptPace(Duration interval, unsigned at_once, std::uint32_t seed)
      : shortest_(interval), at_once_(at_once), random_(seed) {}

  /// The outage begins `now`, or something has changed so much that it counts as a new one.
  void on_outage(Time now) { outage_ = now; }
  void on_attempt(Time now) { attempt_ = now; }
  /// The server answered `now`, and wants none of this robot for now.
  void on_refused(Time now) {
    ++refusals_;
    attempt_ = now;
  }
  void on_welcome() { refusals_ = 0; }
  /// The connection's least round trip: what a link that is back begins with.
  void on_round_trip(Duration round_trip) { round_trip_ = round_trip; }

  /// When to begin the next attempt; may have passed.
  Time next(Time now) { return attempt_ + slowed(interval(now)) * extra_(random_) / kHundred; }
  /// The same for another server, which has not refused the robot.
  Time next_elsewhere(Time now) { return attempt_ + interval(now) * extra_(random_) / kHundred; }
  /// When to begin the first attempt after a connection broke: up to one interval later, at random.
  Time first(Time now) { return std::max(soonest(), now + shortest_ * part_(random_) / kHundred); }

  /// The soonest that it may begin, because something has changed.
  Time soonest() const { return attempt_ + shortest_; }

  Duration round_trip() const { return round_trip_; }
  /// How long there has been no server.
  Duration outage(Time now) const { return now - outage_; }

 private:
  static constexpr int kHundred = 100;
  static constexpr int kPartOfOutage = 600;
  static constexpr Duration kLongestInOutage = std::chrono::seconds(1);
  static constexpr Duration kLongestRefused = std::chrono::seconds(10);

  Duration interval(Time now) const {
    return std::max({shortest_, 2 * round_trip_ / (at_once_ - 1),
                     std::min(outage(now) / kPartOfOutage, kLongestInOutage)});
  }

  Duration slowed(Duration interval) const {
    for (int i = 0; i < refusals_ && interval < kLongestRefused; ++i) interval *= 2;
    return refusals_ > 0 ? std::min(interval, kLongestRefused) : interval;
  }

  const Duration shortest_;
  const unsigned at_once_;
  std::minstd_rand random_;
  std::uniform_int_distribution<int> extra_{kHundred, 130};  // in percent
  std::uniform_int_distribution<int> part_{0, kHundred};
  Time outage_{};
  Time attempt_{};
  Duration round_trip_{0};
  int refusals_ = 0;
};

}  // namespace orbbuf
