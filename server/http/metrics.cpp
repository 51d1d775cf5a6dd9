// SPDX-License-Identifier: Apache-2.0
#include "server/http/metrics.hpp"

#include <prometheus/text_serializer.h>

#include <algorithm>
#include <array>
#include <optional>
#include <utility>
#include <vector>

namespace orbbuf {
namespace {

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;

/// What is asked of one robot; nothing where it is not known.
using Ask = std::optional<double> (*)(const RobotFigures&, RobotFigures::Time);

struct Metric {
  const char* name;
  const char* help;
  MetricType type;
  Ask ask;
};

template <class Number>
std::optional<double> as_value(Number number) {
  return static_cast<double>(number);
}

template <auto Member>
std::optional<double> reported(const RobotFigures& robot, RobotFigures::Time /*now*/) {
  if (!robot.report()) return std::nullopt;
  return as_value((*robot.report()).*Member);
}

template <auto Member>
std::optional<double> counted(const RobotFigures& robot, RobotFigures::Time /*now*/) {
  if (!robot.report()) return std::nullopt;
  return as_value(robot.report()->account.*Member);
}

std::optional<double> round_trip(const RobotFigures& robot, RobotFigures::Time /*now*/) {
  constexpr double kUsPerSecond = 1e6;
  if (!robot.report() || robot.report()->round_trip_us == 0) return std::nullopt;
  return robot.report()->round_trip_us / kUsPerSecond;
}

std::optional<double> age(const RobotFigures& robot, RobotFigures::Time now) {
  const auto age = robot.timeline().age(now);
  return age ? std::optional(to_seconds(*age)) : std::nullopt;
}

std::optional<double> report_age(const RobotFigures& robot, RobotFigures::Time now) {
  if (!robot.report()) return std::nullopt;
  return to_seconds(now - robot.report_time());
}

const auto kMetrics = std::to_array<Metric>({
    {"orbbuf_robot_connected", "1 while the robot has a connection, else 0", MetricType::Gauge,
     [](const auto& robot, auto) { return as_value(robot.is_connected()); }},
    {"orbbuf_connections_total", "Connections of the robot in this session", MetricType::Counter,
     [](const auto& robot, auto) { return as_value(robot.connections()); }},
    {"orbbuf_frames_total", "Frames taken from the robot in this session", MetricType::Counter,
     [](const auto& robot, auto) { return as_value(robot.frames()); }},
    {"orbbuf_frame_bytes_total", "Bytes of their images", MetricType::Counter,
     [](const auto& robot, auto) { return as_value(robot.bytes()); }},
    {"orbbuf_drop_records_total", "Frames that the robot named as not coming", MetricType::Counter,
     [](const auto& robot, auto) { return as_value(robot.drops()); }},
    {"orbbuf_frames_per_second", "Frames taken, of the last second or two", MetricType::Gauge,
     [](const auto& robot, auto now) { return as_value(robot.frame_rate(now)); }},
    {"orbbuf_newest_frame_age_seconds", "Since the newest frame was captured", MetricType::Gauge,
     age},
    {"orbbuf_robot_captured_total", "Frames captured, by the robot's account", MetricType::Counter,
     counted<&wire::Stats::captured>},
    {"orbbuf_robot_skipped_total", "Of these, not encoded: a newer one came", MetricType::Counter,
     counted<&wire::Stats::skipped>},
    {"orbbuf_robot_failed_total", "Of these, could not be encoded", MetricType::Counter,
     counted<&wire::Stats::failed>},
    {"orbbuf_robot_dropped_total", "Of these, given up by the policy or at the end",
     MetricType::Counter, counted<&wire::Stats::dropped>},
    {"orbbuf_robot_acknowledged_total", "Of these, acknowledged by this server",
     MetricType::Counter, counted<&wire::Stats::acknowledged>},
    {"orbbuf_robot_waiting_frames", "Of these, in the buffer", MetricType::Gauge,
     counted<&wire::Stats::waiting>},
    {"orbbuf_robot_in_flight_frames", "Of these, written and not yet acknowledged",
     MetricType::Gauge, counted<&wire::Stats::in_flight>},
    {"orbbuf_robot_buffer_capacity_frames", "Frames that the buffer holds", MetricType::Gauge,
     reported<&wire::Report::capacity>},
    {"orbbuf_robot_waiting_bytes", "Bytes of the images in the buffer", MetricType::Gauge,
     reported<&wire::Report::waiting_bytes>},
    {"orbbuf_robot_link_bytes_per_second", "What the link carried lately", MetricType::Gauge,
     reported<&wire::Report::link_rate>},
    {"orbbuf_robot_round_trip_seconds", "TCP's round trip, smoothed", MetricType::Gauge,
     round_trip},
    {"orbbuf_robot_report_age_seconds", "Since the robot's account came", MetricType::Gauge,
     report_age},
});

ClientMetric of_robot(const RobotFigures& robot, MetricType type, double value) {
  ClientMetric metric;
  metric.label = {{"robot", robot.info().robot_id}};
  (type == MetricType::Counter ? metric.counter.value : metric.gauge.value) = value;
  return metric;
}

MetricFamily family_of(const Metric& metric, const Figures& figures, RobotFigures::Time now) {
  MetricFamily family{metric.name, metric.help, metric.type, {}};
  for (const auto& [id, robot] : figures.robots()) {
    if (const auto value = metric.ask(*robot, now)) {
      family.metric.push_back(of_robot(*robot, metric.type, *value));
    }
  }
  return family;
}

MetricFamily sessions_of(const Figures& figures) {
  MetricFamily family{
      "orbbuf_session_info", "1: the robot's latest session", MetricType::Gauge, {}};
  for (const auto& [id, robot] : figures.robots()) {
    family.metric.push_back(of_robot(*robot, MetricType::Gauge, 1));
    family.metric.back().label.push_back({"session", robot->info().session_id});
  }
  return family;
}

}  // namespace

std::string to_metrics(const Figures& figures, RobotFigures::Time now) {
  std::vector<MetricFamily> families;
  families.push_back(sessions_of(figures));
  for (const Metric& metric : kMetrics) families.push_back(family_of(metric, figures, now));
  std::erase_if(families, [](const MetricFamily& family) { return family.metric.empty(); });
  return prometheus::TextSerializer().Serialize(families);
}

}  // namespace orbbuf
