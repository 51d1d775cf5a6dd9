// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/reporter.hpp"

#include <utility>

namespace orbbuf {

void Reporter::look(Time now, const wire::Stats& stats,
                    const std::optional<TcpProgress>& progress) {
  next_look_ += kInterval;
  measure(now, progress);
  is_due_ = stats != sent_ || now >= sent_time_ + kQuietInterval;
}

/// A new connection counts its bytes from 0.
void Reporter::measure(Time now, const std::optional<TcpProgress>& progress) {
  const std::chrono::duration<double> time = now - std::exchange(measured_time_, now);
  const std::uint64_t acked = progress ? progress->acked_bytes : 0;
  const std::uint64_t before = std::exchange(acked_bytes_, acked);
  const std::uint64_t bytes = acked >= before ? acked - before : acked;
  link_rate_ = static_cast<std::uint64_t>(static_cast<double>(bytes) / time.count());
  round_trip_us_ = progress ? static_cast<std::uint32_t>(progress->round_trip.count()) : 0;
}

wire::Report Reporter::take(Time now, wire::Report report) {
  is_due_ = false;
  sent_ = report.stats;
  sent_time_ = now;
  report.link_rate = link_rate_;
  report.round_trip_us = round_trip_us_;
  return report;
}

}  // namespace orbbuf
