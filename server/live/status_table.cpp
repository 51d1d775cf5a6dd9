// SPDX-License-Identifier: Apache-2.0
#include "server/live/status_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstddef>
#include <optional>
#include <vector>

#include "common/seconds.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kColumns = 17;
constexpr std::size_t kWords = 3;  // at the left of their columns; numbers are at the right
using Row = std::array<std::string, kColumns>;

std::string to_text(std::optional<std::chrono::nanoseconds> age) {
  if (!age) return "-";
  return to_seconds(*age) < 1 ? fmt::format("{:.0f} ms", std::max(0.0, 1e3 * to_seconds(*age)))
                              : fmt::format("{:.1f} s", to_seconds(*age));
}

Row row_of(const RobotMetrics& robot, RobotMetrics::Time now) {
  const bool is_connected = robot.is_connected();
  Row row{robot.info().robot_id, robot.info().session_id, robot.state(),
          fmt::format("{:.1f}", robot.frame_rate(now)),
          robot.is_ended() ? "-" : to_text(robot.timeline().age(now))};
  std::fill(row.begin() + 5, row.end(), std::string(1, '-'));
  row[13] = std::to_string(robot.late());
  if (robot.quality() > 0) row[15] = std::to_string(robot.quality());
  row[16] = std::to_string(robot.reduced());
  if (const auto& held = robot.on_robot()) {
    row[14] = held->present == held->all ? std::to_string(held->all)
                                         : fmt::format("{}/{}", held->present, held->all);
  }
  if (!robot.report()) return row;
  const wire::Report& report = *robot.report();
  const wire::Stats& stats = report.stats;
  row[5] = fmt::format("{}/{}", stats.waiting, report.capacity);
  if (is_connected)
    row[6] = fmt::format("{:.2f} MB/s", static_cast<double>(report.link_rate) / 1e6);
  if (is_connected && report.round_trip_us > 0) {
    row[7] = fmt::format("{:.1f} ms", report.round_trip_us / 1e3);
  }
  row[8] = std::to_string(stats.captured);
  row[9] = std::to_string(stats.acknowledged);
  row[10] = std::to_string(stats.dropped);
  row[11] = std::to_string(stats.skipped);
  row[12] = std::to_string(stats.failed);
  return row;
}

}  // namespace

std::string to_table(const Metrics& metrics, RobotMetrics::Time now) {
  std::vector<Row> rows{{"ROBOT", "SESSION", "STATE", "FRAMES/S", "AGE", "BUFFER", "LINK",
                         "ROUND TRIP", "CAPTURED", "DELIVERED", "DROPPED", "SKIPPED", "FAILED",
                         "LATE", "ON ROBOT", "QUALITY", "REDUCED"}};
  for (const auto& [id, robot] : metrics.robots()) rows.push_back(row_of(*robot, now));
  std::array<std::size_t, kColumns> widths{};
  for (const Row& row : rows) {
    for (std::size_t i = 0; i < kColumns; ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string table;
  for (const Row& row : rows) {
    for (std::size_t i = 0; i < kColumns; ++i) {
      if (i > 0) table += "  ";
      table += i < kWords ? fmt::format("{:<{}}", row[i], widths[i])
                          : fmt::format("{:>{}}", row[i], widths[i]);
    }
    table += '\n';
  }
  return table;
}

}  // namespace orbbuf
