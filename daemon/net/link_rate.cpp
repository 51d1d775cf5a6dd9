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
constexpr std::size_t kLeastFrames = 2;    // one is sent while the next one waits
constexpr double kBeyondS = 0.1;

}  // namespace

void LinkRate::on_written(Time now, Sequence sequence, std::size_t bytes) {
  on_their_way_.push_back({sequence, bytes, now});
}

/// Frames that are received together are one observation.
void LinkRate::on_received(Time now, Sequence next, std::chrono::nanoseconds round_trip) {
  if (on_their_way_.empty() || on_their_way_.front().sequence >= next) return;
  const Time begin = std::max(received_time_, on_their_way_.front().time + round_trip);
  double bytes = 0;
  while (!on_their_way_.empty() && on_their_way_.front().sequence < next) {
    bytes += static_cast<double>(on_their_way_.front().bytes);
    on_their_way_.pop_front();
  }
  received_time_ = now;
  observe(bytes, std::max(kShortestService, to_seconds(now - begin)));
}

/// A single long one is an outage. If they go on, the link has become slow: each counts for more.
void LinkRate::observe(double bytes, double service_s) {
  if (service_s_ > 0) {
    const double limit_s = longest_ * bytes / bytes_per_s();
    longest_ = service_s > limit_s ? 2 * longest_ : kLongest;
    service_s = std::min(service_s, limit_s);
  }
  const double kept = std::min(std::exp(-service_s / kMemoryS), 1 - 1 / kMemoryFrames);
  bytes_ = kept * bytes_ + bytes;
  service_s_ = kept * service_s_ + service_s;
}

double LinkRate::bytes_per_s() const { return service_s_ > 0 ? bytes_ / service_s_ : 0; }

bool LinkRate::has_room(std::chrono::nanoseconds round_trip) const {
  if (on_their_way_.size() < kLeastFrames) return true;
  double bytes = 0;
  for (const Written& written : on_their_way_) bytes += static_cast<double>(written.bytes);
  return bytes < bytes_per_s() * (2 * to_seconds(round_trip) + kBeyondS);
}

LinkRate::Time LinkRate::served_at(std::chrono::nanoseconds round_trip) const {
  return served_at(on_their_way_.size(), round_trip);
}

bool LinkRate::is_overdue(Time now, std::chrono::nanoseconds round_trip) const {
  if (on_their_way_.empty()) return false;
  return service_s_ <= 0 || now > served_at(1, round_trip) + round_trip;
}

/// The first ones of those on their way.
LinkRate::Time LinkRate::served_at(std::size_t frames, std::chrono::nanoseconds round_trip) const {
  const double seconds_per_byte = service_s_ > 0 ? service_s_ / bytes_ : 0;
  Time time = received_time_ - round_trip;
  for (std::size_t i = 0; i < frames; ++i) {
    const Written& written = on_their_way_[i];
    const std::chrono::duration<double> service(static_cast<double>(written.bytes) *
                                                seconds_per_byte);
    time = std::max(time, written.time) + std::chrono::duration_cast<Time::duration>(service);
  }
  return time;
}

}  // namespace orbbuf
