// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/link_rate.hpp"

#include <algorithm>
#include <cmath>

namespace orbbuf {
namespace {

constexpr double kMemorySeconds = 1;
constexpr double kMemoryObservations = 50;
constexpr double kFastest = 1e9;  // bytes a second: clocks are too coarse to tell more
constexpr int kStartRoundTrips = 10;

}  // namespace

void LinkRate::on_connected(Time now) {
  in_flight_.clear();
  bytes_in_flight_ = 0;
  connected_time_ = acknowledged_time_ = now;
  limit_ = kLimit;
}

void LinkRate::on_write(Sequence sequence, std::size_t bytes, Time now) {
  in_flight_.push_back({sequence, bytes, now});
  bytes_in_flight_ += bytes;
}

void LinkRate::on_acknowledged(Sequence next, Time now, std::chrono::nanoseconds min_round_trip) {
  if (in_flight_.empty() || in_flight_.front().sequence >= next) return;
  const Time begin = std::max(acknowledged_time_, in_flight_.front().time + min_round_trip);
  std::uint64_t bytes = 0;
  for (; !in_flight_.empty() && in_flight_.front().sequence < next; in_flight_.pop_front()) {
    bytes += in_flight_.front().bytes;
  }
  bytes_in_flight_ -= bytes;
  acknowledged_time_ = now;
  observe(static_cast<double>(bytes), now - begin,
          now < connected_time_ + kStartRoundTrips * min_round_trip);
}

void LinkRate::observe(double bytes, std::chrono::duration<double> service, bool is_starting) {
  double seconds = std::max(service.count(), bytes / kFastest);
  if (seconds_ > 0) {
    const double predicted = bytes / bytes_per_s();
    const double limit = is_starting ? 1 : limit_;
    const bool is_over = seconds > limit * predicted;
    if (is_over) seconds = limit * predicted;
    limit_ = is_over && !is_starting ? 2 * limit_ : kLimit;
  }
  const double kept = std::exp(-seconds / kMemorySeconds - 1 / kMemoryObservations);
  bytes_ = kept * bytes_ + bytes;
  seconds_ = kept * seconds_ + seconds;
}

}  // namespace orbbuf
