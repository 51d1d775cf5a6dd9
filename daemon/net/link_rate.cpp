// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/link_rate.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "common/seconds.hpp"

namespace orbbuf {
namespace {

constexpr double kMemoryS = 1;
constexpr double kMemoryFrames = 16;
constexpr double kShortestService = 1e-6;  // seconds
constexpr double kLongest = 4;             // of what is expected
constexpr double kSlow = 2;                // the same, of a link that may have become slow
constexpr double kAtOnce = 32e3;           // bytes: the burst that many shapers pass
constexpr double kLeastWeight = 1.0 / 8;   // of what was passed at once
constexpr double kMostOfStream = 3;        // the rate, of what the stream carries
constexpr double kFirstWindow = 14'600;    // bytes that a TCP connection sends at first
constexpr double kPartOfSlowStart = 0.5;   // the rate was perhaps taken too high
constexpr std::size_t kLeastFrames = 2;    // one is sent while the next one waits
constexpr double kBeyondS = 0.03;
constexpr double kLateS = 0.02;
constexpr double kFadeS = 3;  // a link may fade for so long before it breaks
// Of frames that came to an idle link:
constexpr std::chrono::seconds kSettling{1};  // those of a new connection do not count
constexpr std::size_t kMostIdle = 8;          // so many do
constexpr std::size_t kLeastIdle = 3;
constexpr std::chrono::seconds kMeasureEach{2};
constexpr int kMeasureTrips = 8;  // and so many: the link is idle for one or two
constexpr std::chrono::milliseconds kUsualDelay{20};  // more than that may hide a faster link
constexpr double kFaster = 1.03;
constexpr double kMostOfCarried = 2;

}  // namespace

void LinkRate::on_written(Time now, Sequence sequence, std::size_t bytes) {
  if (!begun_) begun_ = learn_time_ = now;
  on_their_way_.push_back({sequence, bytes, now});
}

void LinkRate::on_lost() {
  on_their_way_.clear();
  slow_.reset();
  begun_.reset();
  beyond_s_.clear();
  usual_ = {};
  const auto before_slow = std::exchange(before_slow_, std::nullopt);
  if (std::exchange(is_new_, true)) return;
  if (before_slow) sums_ = *before_slow;
  sums_.service_s = std::max(sums_.service_s, sums_.passed_s / kMostOfStream) / kMemoryFrames;
  sums_.bytes /= kMemoryFrames;
  sums_.passed_s /= kMemoryFrames;
}

/// Slow start doubles what is sent in each round trip until it fills the link.
void LinkRate::begin_connection(double round_trip_s) {
  tokens_ = kAtOnce;
  const double windows = bytes_per_s() * round_trip_s / kFirstWindow;
  slow_start_s_ = windows > 1 ? kPartOfSlowStart * round_trip_s * std::log2(windows) : 0;
}

/// The median: what is now and then on its way as well does not change it.
void LinkRate::learn_path(Time now, const Written& frame, std::chrono::nanoseconds round_trip) {
  learn_time_ = now;
  if (sums_.service_s <= 0 || frame.time - *begun_ < kSettling) return;
  const double service_s = static_cast<double>(frame.bytes) / bytes_per_s();
  beyond_s_.push_back(std::max(0.0, to_seconds(now - frame.time - round_trip) - service_s));
  if (beyond_s_.size() > kMostIdle) beyond_s_.pop_front();
  if (beyond_s_.size() < kLeastIdle) return;
  auto sorted = beyond_s_;
  const auto median = sorted.begin() + static_cast<std::ptrdiff_t>(sorted.size() / 2);
  std::nth_element(sorted.begin(), median, sorted.end());
  usual_ =
      std::chrono::duration_cast<std::chrono::nanoseconds>(std::chrono::duration<double>(*median));
}

/// Frames that are received together are one observation.
void LinkRate::on_received(Time now, Sequence next, std::chrono::nanoseconds round_trip) {
  if (on_their_way_.empty() || on_their_way_.front().sequence >= next) return;
  const Written first = on_their_way_.front();
  const bool has_company = on_their_way_.size() > 1 && on_their_way_[1].sequence < next;
  const bool was_idle = first.time + round_trip >= received_time_;
  if (was_idle && !has_company) learn_path(now, first, round_trip);
  const Time ready = first.time + path(round_trip);
  Observation seen;
  while (!on_their_way_.empty() && on_their_way_.front().sequence < next) {
    seen.bytes += static_cast<double>(on_their_way_.front().bytes);
    on_their_way_.pop_front();
  }
  seen.service_s = std::max(kShortestService, to_seconds(now - std::max(received_time_, ready)));
  if (std::exchange(is_new_, false)) {
    begin_connection(to_seconds(round_trip));
  } else {
    seen.idle_s = std::max(0.0, to_seconds(ready - received_time_));
  }
  received_time_ = now;
  observe(seen);
  // A link that is idle between frames may be faster than what they tell of it.
  const bool may_be_faster = seen.idle_s > 0 && !slow_ && usual_ > kUsualDelay;
  if (may_be_faster && sums_.passed_s < kMostOfCarried * sums_.service_s)
    sums_.service_s /= kFaster;
}

void LinkRate::observe(Observation seen) {
  if (sums_.service_s <= 0) return add(seen, 1);
  const double rate = bytes_per_s();
  slow_for_s_ += seen.service_s + seen.idle_s;
  const bool is_as_before =
      before_slow_ && rate > before_slow_->bytes / before_slow_->service_s / kSlow;
  if (is_as_before || slow_for_s_ > kFadeS) before_slow_.reset();
  const double tokens = std::max(tokens_, std::min(kAtOnce, tokens_ + rate * seen.idle_s));
  const double at_once = std::min(tokens, seen.bytes);
  tokens_ = std::clamp(tokens + rate * seen.service_s - seen.bytes, 0.0, std::max(tokens, kAtOnce));
  const double expected_s = seen.bytes / rate;
  const double slow_start_s = std::clamp(seen.service_s - expected_s, 0.0, slow_start_s_);
  slow_start_s_ -= slow_start_s;
  seen.service_s -= slow_start_s;
  const auto before = std::exchange(slow_, std::nullopt);
  if (is_slow(seen.service_s, expected_s)) {
    if (before && seen.idle_s < seen.service_s) return become_slow(*before, seen);
    slow_ = seen;
  }
  // A single long one is an outage, and what was on its way meanwhile may come at once.
  const double limit_s = kLongest * expected_s;
  if (seen.service_s > limit_s) tokens_ = std::max(tokens_, bytes_on_their_way());
  seen.service_s = std::min(seen.service_s, limit_s);

  double weight = 1;
  if (seen.bytes - at_once > rate * seen.service_s) {
    seen.bytes -= at_once;  // it is faster even without them
  } else if (seen.idle_s > 0) {
    weight = std::max(kLeastWeight, 1 - at_once / seen.bytes);
  } else {  // only a slower one would say something
    seen.service_s = std::max(seen.service_s, expected_s);
  }
  add(seen, weight);
}

/// The link has changed, and what was seen before tells nothing.
void LinkRate::become_slow(const Observation& before, const Observation& seen) {
  if (!before_slow_) {
    before_slow_ = sums_;
    slow_for_s_ = 0;
  }
  sums_.bytes = before.bytes + seen.bytes;
  sums_.service_s = before.service_s + seen.service_s;
  sums_.passed_s = sums_.service_s;
}

bool LinkRate::is_slow(double service_s, double expected_s) {
  return service_s > std::max(kSlow * expected_s, expected_s + kLateS);
}

void LinkRate::add(const Observation& seen, double weight) {
  const double service_s = weight * seen.service_s;
  const double kept = std::min(std::exp(-service_s / kMemoryS), 1 - weight / kMemoryFrames);
  sums_.bytes = kept * sums_.bytes + weight * seen.bytes;
  sums_.service_s = kept * sums_.service_s + service_s;
  sums_.passed_s = kept * sums_.passed_s + service_s + weight * seen.idle_s;
}

double LinkRate::bytes_per_s(Time now, std::chrono::nanoseconds round_trip) const {
  return is_doubtful(now, round_trip) ? bytes_per_s() / kSlow : bytes_per_s();
}

bool LinkRate::is_doubtful(Time now, std::chrono::nanoseconds round_trip) const {
  if (slow_) return true;
  if (on_their_way_.empty() || sums_.service_s <= 0) return false;
  const Written& first = on_their_way_.front();
  const double served_s = to_seconds(now - std::max(received_time_, first.time + path(round_trip)));
  return is_slow(served_s, static_cast<double>(first.bytes) / bytes_per_s());
}

bool LinkRate::has_room(Time now, std::chrono::nanoseconds round_trip) const {
  const bool is_measure_due =
      usual_ > kUsualDelay && now - learn_time_ > kMeasureEach + kMeasureTrips * path(round_trip);
  if (is_measure_due || is_doubtful(now, round_trip)) return on_their_way_.empty();
  if (on_their_way_.size() < kLeastFrames) return true;
  const double bytes = bytes_on_their_way() + static_cast<double>(on_their_way_.back().bytes);
  return bytes < bytes_per_s() * (2 * to_seconds(path(round_trip)) + kBeyondS);
}

double LinkRate::bytes_on_their_way() const {
  double bytes = 0;
  for (const Written& written : on_their_way_) bytes += static_cast<double>(written.bytes);
  return bytes;
}

LinkRate::Time LinkRate::served_at(std::chrono::nanoseconds round_trip) const {
  return served_at(on_their_way_.size(), round_trip);
}

bool LinkRate::is_overdue(Time now, std::chrono::nanoseconds round_trip) const {
  if (on_their_way_.empty()) return false;
  return sums_.service_s <= 0 || now > served_at(1, round_trip) + path(round_trip);
}

/// The first ones of those on their way.
LinkRate::Time LinkRate::served_at(std::size_t frames, std::chrono::nanoseconds round_trip) const {
  const double seconds_per_byte = sums_.service_s > 0 ? sums_.service_s / sums_.bytes : 0;
  Time time = received_time_ - path(round_trip);
  for (std::size_t i = 0; i < frames; ++i) {
    const Written& written = on_their_way_[i];
    const std::chrono::duration<double> service(static_cast<double>(written.bytes) *
                                                seconds_per_byte);
    time = std::max(time, written.time) + std::chrono::duration_cast<Time::duration>(service);
  }
  return time;
}

}  // namespace orbbuf
