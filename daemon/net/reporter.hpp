// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <utility>

#include "common/wire.hpp"
#include "daemon/net/tcp_progress.hpp"

namespace orbbuf {

/// Decides when the robot sends a report to the server, and measures the link: a report is due once
/// a second, or every four while the stats do not change. Knows no clock and no socket. Reentrant.
class Reporter {
 public:
  using Time = std::chrono::steady_clock::time_point;

  void start(Time now) { next_look_ = now + kInterval; }
  /// Whether a second has passed since the last look().
  bool is_time(Time now) const { return now >= next_look_; }
  /// `stats`: those at `now`; `progress`: what the kernel says of the connection, if there is one.
  void look(Time now, const wire::Stats& stats, const std::optional<TcpProgress>& progress) {
    next_look_ += kInterval;
    measure(now, progress);
    is_due_ = stats != sent_ || now >= sent_time_ + kQuietInterval;
  }

  bool is_due() const { return is_due_; }
  /// `report`, of the buffer, with what is known of the link: to be sent `now`.
  wire::Report take(Time now, wire::Report report) {
    is_due_ = false;
    sent_ = report.stats;
    sent_time_ = now;
    report.link_rate = link_rate_;
    report.round_trip_us = round_trip_us_;
    return report;
  }

 private:
  static constexpr std::chrono::seconds kInterval{1};
  static constexpr std::chrono::seconds kQuietInterval{4};

  /// A new connection counts its bytes from 0.
  void measure(Time now, const std::optional<TcpProgress>& progress) {
    const std::chrono::duration<double> time = now - std::exchange(measured_time_, now);
    const std::uint64_t acked = progress ? progress->acked_bytes : 0;
    const std::uint64_t before = std::exchange(acked_bytes_, acked);
    const std::uint64_t bytes = acked >= before ? acked - before : acked;
    link_rate_ = static_cast<std::uint64_t>(static_cast<double>(bytes) / time.count());
    round_trip_us_ = progress ? static_cast<std::uint32_t>(progress->round_trip.count()) : 0;
  }

  Time next_look_;
  bool is_due_ = false;
  wire::Stats sent_;  // the last stats that were taken
  Time sent_time_;
  Time measured_time_;
  std::uint64_t acked_bytes_ = 0;  // by then, of the connection that there was
  std::uint64_t link_rate_ = 0;
  std::uint32_t round_trip_us_ = 0;
};

}  // namespace orbbuf
