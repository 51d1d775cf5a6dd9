// SPDX-License-Identifier: Apache-2.0
#include "server/http/views.hpp"

#include <fmt/core.h>
#include <openssl/evp.h>
#include <prometheus/text_serializer.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <initializer_list>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>
#include <utility>
#include <vector>

#include "common/calibration/calibration.hpp"
#include "common/seconds.hpp"
#include "common/wire.hpp"
#include "server/http/page_parts.hpp"  // made of page/ by CMake
#include "server/session/session_names.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;

std::uint64_t to_ms(RobotMetrics::Time time) {
  using std::chrono::milliseconds;
  return static_cast<std::uint64_t>(
      std::chrono::duration_cast<milliseconds>(time.time_since_epoch()).count());
}

/// Keeps the order of its fields.
using Json = nlohmann::ordered_json;

/// In seconds, to the millisecond.
double rounded(std::chrono::nanoseconds time) { return std::round(to_seconds(time) * 1e3) / 1e3; }

Json report_of(const wire::Report& report, std::chrono::nanoseconds age) {
  const wire::Stats& stats = report.stats;
  return {{"age_s", rounded(age)},
          {"captured", stats.captured},
          {"skipped", stats.skipped},
          {"failed", stats.failed},
          {"dropped", stats.dropped},
          {"acknowledged", stats.acknowledged},
          {"waiting", stats.waiting},
          {"in_flight", stats.in_flight},
          {"capacity", report.capacity},
          {"waiting_bytes", report.waiting_bytes},
          {"link_rate", report.link_rate},
          {"round_trip_us", report.round_trip_us},
          {"irreducible", report.irreducible}};
}

/// Nothing has come for longer than the robot is ever silent.
bool is_silent(const RobotMetrics& robot, RobotMetrics::Time now) {
  constexpr std::chrono::seconds kLongestPause{5};
  return !robot.is_ended() &&
         (!robot.is_connected() || now - robot.timeline().last_heard() > kLongestPause);
}

void add_timeline(Json& json, const RobotMetrics& robot, std::uint64_t since_ms,
                  RobotMetrics::Time now) {
  const Timeline& timeline = robot.timeline();
  auto outages = Json::array();
  for (const Outage& outage : timeline.outages()) {
    outages.push_back(Json::array({rounded(outage.begin), rounded(outage.end)}));
  }
  if (is_silent(robot, now)) {
    const auto begin = timeline.robot_time(timeline.last_heard());
    outages.push_back(Json::array({rounded(begin), nullptr}));
  }
  auto seconds = Json::array();
  for (const TimelineSecond& second : timeline.seconds()) {
    if (to_ms(second.changed) < since_ms) continue;
    const int similarity = second.similarity == kUnknownSimilarity ? -1 : second.similarity;
    seconds.push_back(Json::array(
        {second.second, second.delivered, second.dropped, similarity, second.delay_ms}));
  }
  for (std::size_t i = 0; const auto& [name, stream] : robot.streams()) {
    Json& news = json["streams"][i++]["seconds"] = Json::array();
    for (const SampleSecond& second : stream.seconds) {
      if (to_ms(second.changed) < since_ms) continue;
      news.push_back(Json::array({second.second, second.samples, second.lost,
                                  std::lround(second.fastest_turn), second.longest_gap_ms}));
    }
  }
  json["now"] = rounded(timeline.robot_time(robot.ended_at().value_or(now)));
  json["outages"] = std::move(outages);
  json["seconds"] = std::move(seconds);
}

Json robot_of(const RobotMetrics& robot, RobotMetrics::Time now) {
  Json json{{"robot", robot.info().robot_id},
            {"session", robot.info().session_id},
            {"state", robot.state()},
            {"connections", robot.connections()},
            {"frames", robot.frames()},
            {"bytes", robot.bytes()},
            {"drops", robot.drops()},
            {"frame_rate", std::round(robot.frame_rate(now) * 100) / 100},
            {"late", robot.late()},
            {"late_total", robot.late_total()},
            {"reduced", robot.reduced()}};
  for (const auto& [name, stream] : robot.streams()) {
    Json& each = json["streams"].emplace_back();
    each = {{"name", name},
            {"captured", stream.captured},
            {"samples", stream.samples},
            {"waiting", stream.waiting()},
            {"lost", stream.lost},
            {"rate", std::round(stream.rate.per_second(now) * 10) / 10}};
    if (const auto age = stream.age(now)) each["age_s"] = rounded(*age);
  }
  if (robot.quality() > 0) json["quality"] = robot.quality();
  if (const auto& held = robot.on_robot()) {
    json["on_robot"] = held->present;
    json["on_robot_total"] = held->all;
  }
  if (const auto age = robot.timeline().age(now)) json["age_s"] = rounded(*age);
  if (const FramePtr& frame = robot.newest()) {
    json["image"] = {{"sequence", frame->sequence},
                     {"width", frame->width_px},
                     {"height", frame->height_px},
                     {"is_stereo", frame->is_stereo()}};
  }
  if (robot.report()) json["report"] = report_of(*robot.report(), now - robot.report_time());
  return json;
}

constexpr std::size_t kMostNames = 1000;

using prometheus::ClientMetric;
using prometheus::MetricFamily;
using prometheus::MetricType;

/// What is asked of one robot; nothing where it is not known.
using Ask = std::optional<double> (*)(const RobotMetrics&, RobotMetrics::Time);

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
std::optional<double> reported(const RobotMetrics& robot, RobotMetrics::Time /*now*/) {
  if (!robot.report()) return std::nullopt;
  return as_value((*robot.report()).*Member);
}

template <auto Member>
std::optional<double> counted(const RobotMetrics& robot, RobotMetrics::Time /*now*/) {
  if (!robot.report()) return std::nullopt;
  return as_value(robot.report()->stats.*Member);
}

std::optional<double> round_trip(const RobotMetrics& robot, RobotMetrics::Time /*now*/) {
  constexpr double kUsPerSecond = 1e6;
  if (!robot.report() || robot.report()->round_trip_us == 0) return std::nullopt;
  return robot.report()->round_trip_us / kUsPerSecond;
}

std::optional<double> age(const RobotMetrics& robot, RobotMetrics::Time now) {
  const auto age = robot.timeline().age(now);
  return age ? std::optional(to_seconds(*age)) : std::nullopt;
}

std::optional<double> report_age(const RobotMetrics& robot, RobotMetrics::Time now) {
  if (!robot.report()) return std::nullopt;
  return to_seconds(now - robot.report_time());
}

std::optional<double> quality(const RobotMetrics& robot, RobotMetrics::Time /*now*/) {
  if (robot.quality() == 0) return std::nullopt;
  return as_value(robot.quality());
}

std::optional<double> on_robot(const RobotMetrics& robot, RobotMetrics::Time /*now*/) {
  if (!robot.on_robot()) return std::nullopt;
  return as_value(robot.on_robot()->all);
}

const auto kMetrics = std::to_array<Metric>({
    {"orbbuf_robot_connected", "1 while the robot has a connection, else 0", MetricType::Gauge,
     [](const auto& robot, auto) { return as_value(robot.is_connected()); }},
    {"orbbuf_stream_paused", "1 while a sink fails and the robot's stream waits for it, else 0",
     MetricType::Gauge, [](const auto& robot, auto) { return as_value(!robot.pause().empty()); }},
    {"orbbuf_connections_total", "Connections of the robot in this session", MetricType::Counter,
     [](const auto& robot, auto) { return as_value(robot.connections()); }},
    {"orbbuf_frames_total", "Frames taken from the robot in this session", MetricType::Counter,
     [](const auto& robot, auto) { return as_value(robot.frames()); }},
    {"orbbuf_frame_bytes_total", "Bytes of their images", MetricType::Counter,
     [](const auto& robot, auto) { return as_value(robot.bytes()); }},
    {"orbbuf_frames_reduced_total", "Of the frames taken, with a reduced JPEG", MetricType::Counter,
     [](const auto& robot, auto) { return as_value(robot.reduced()); }},
    {"orbbuf_frame_quality", "JPEG quality of the newest frame", MetricType::Gauge, quality},
    {"orbbuf_drop_records_total", "Frames that the robot named as not coming", MetricType::Counter,
     [](const auto& robot, auto) { return as_value(robot.drops()); }},
    {"orbbuf_unpublished_frames_total", "Of the frames taken, given up by [ros] and [dds]",
     MetricType::Counter, [](const auto& robot, auto) { return as_value(robot.lost()); }},
    {"orbbuf_late_total", "Frames that arrived late, of all the robot's sessions",
     MetricType::Counter, [](const auto& robot, auto) { return as_value(robot.late_total()); }},
    {"orbbuf_on_robot", "Frames that the robot keeps to send them late, of all its sessions",
     MetricType::Gauge, on_robot},
    {"orbbuf_frames_per_second", "Frames taken, of the last second or two", MetricType::Gauge,
     [](const auto& robot, auto now) { return as_value(robot.frame_rate(now)); }},
    {"orbbuf_newest_frame_age_seconds", "Since the newest frame was captured", MetricType::Gauge,
     age},
    {"orbbuf_robot_captured_total", "Frames captured, as the robot reports", MetricType::Counter,
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
    {"orbbuf_robot_irreducible_total", "Frames to be reduced whose JPEG could not be read",
     MetricType::Counter, reported<&wire::Report::irreducible>},
    {"orbbuf_robot_report_age_seconds", "Age of the robot's last report", MetricType::Gauge,
     report_age},
});

ClientMetric of_robot(const RobotMetrics& robot, MetricType type, double value) {
  ClientMetric metric;
  metric.label = {{"robot", robot.info().robot_id}};
  (type == MetricType::Counter ? metric.counter.value : metric.gauge.value) = value;
  return metric;
}

MetricFamily family_of(const Metric& metric, const Metrics& metrics, RobotMetrics::Time now) {
  MetricFamily family{metric.name, metric.help, metric.type, {}};
  for (const auto& [id, robot] : metrics.robots()) {
    if (const auto value = metric.ask(*robot, now)) {
      family.metric.push_back(of_robot(*robot, metric.type, *value));
    }
  }
  return family;
}

MetricFamily family_of_streams(const char* name, const char* help, MetricType type,
                               const Metrics& metrics,
                               const std::function<double(const StreamMetrics&)>& ask) {
  MetricFamily family{name, help, type, {}};
  for (const auto& [id, robot] : metrics.robots()) {
    for (const auto& [sensor, stream] : robot->streams()) {
      if (stream.samples == 0) continue;
      family.metric.push_back(of_robot(*robot, type, ask(stream)));
      family.metric.back().label.push_back({"stream", sensor});
    }
  }
  return family;
}

MetricFamily sessions_of(const Metrics& metrics) {
  MetricFamily family{
      "orbbuf_session_info", "1: the robot's latest session", MetricType::Gauge, {}};
  for (const auto& [id, robot] : metrics.robots()) {
    family.metric.push_back(of_robot(*robot, MetricType::Gauge, 1));
    family.metric.back().label.push_back({"session", robot->info().session_id});
  }
  return family;
}

MetricFamily of_server(const char* name, const char* help, MetricType type, std::uint64_t value) {
  MetricFamily family{name, help, type, {}};
  ClientMetric metric;
  (type == MetricType::Counter ? metric.counter.value : metric.gauge.value) =
      static_cast<double>(value);
  family.metric.push_back(std::move(metric));
  return family;
}

/// `'sha256-...'`, as a policy of contents names what may be run.
std::string hash_of(std::string_view text) {
  std::array<unsigned char, EVP_MAX_MD_SIZE> digest{};
  unsigned size = 0;
  ::EVP_Digest(text.data(), text.size(), digest.data(), &size, ::EVP_sha256(), nullptr);
  std::array<unsigned char, std::size_t{2} * EVP_MAX_MD_SIZE> base64{};
  ::EVP_EncodeBlock(base64.data(), digest.data(), static_cast<int>(size));
  return fmt::format("'sha256-{}'", reinterpret_cast<const char*>(base64.data()));
}

std::string with(std::string text, std::string_view placeholder, std::string_view part) {
  return text.replace(text.find(placeholder), placeholder.size(), part);
}

HttpResponse make_page() {
  auto html = with(with(kPageHtml, "/* page.css */", kPageCss), "/* page.js */", kPageJs);
  auto response = text_response(std::move(html), "text/html; charset=utf-8");
  response.policy = fmt::format(
      "default-src 'none'; script-src {}; style-src {}; img-src 'self' data:; connect-src 'self'; "
      "base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
      hash_of(kPageJs), hash_of(kPageCss));
  return response;
}

}  // namespace

std::string to_json(const Metrics& metrics, std::uint64_t since_ms, RobotMetrics::Time now) {
  auto robots = Json::array();
  for (const auto& [id, robot] : metrics.robots()) {
    add_timeline(robots.emplace_back(robot_of(*robot, now)), *robot, since_ms, now);
  }
  const Json all{
      {"version", ORBBUF_VERSION}, {"clock_ms", to_ms(now)}, {"robots", std::move(robots)}};
  return all.dump() + '\n';
}

std::string to_json(const RobotMetrics& robot, RobotMetrics::Time now) {
  Json json = robot_of(robot, now);
  json["lost"] = robot.lost();
  return json.dump();
}

std::string robot_schema() {
  const auto numbers = [](std::initializer_list<const char*> names) {
    Json fields;
    for (const char* const name : names) fields[name]["type"] = "number";
    return fields;
  };
  Json image = numbers({"sequence", "width", "height"});
  image["is_stereo"]["type"] = "boolean";
  const Json report = numbers({"age_s", "captured", "skipped", "failed", "dropped", "acknowledged",
                               "waiting", "in_flight", "capacity", "waiting_bytes", "link_rate",
                               "round_trip_us", "irreducible"});
  Json robot =
      numbers({"connections", "frames", "bytes", "drops", "frame_rate", "late", "late_total",
               "reduced", "quality", "on_robot", "on_robot_total", "age_s", "lost"});
  for (const char* const name : {"robot", "session", "state"}) robot[name]["type"] = "string";
  robot["image"] = {{"type", "object"}, {"properties", image}};
  robot["report"] = {{"type", "object"}, {"properties", report}};
  const Json schema{{"title", kRobotSchemaName}, {"type", "object"}, {"properties", robot}};
  return schema.dump();
}

std::optional<std::string> folders_json(const fs::path& folder) {
  std::error_code failed;
  std::set<std::string, std::greater<>> names;
  fs::directory_iterator entry(folder, failed);
  for (; !failed && entry != fs::directory_iterator(); entry.increment(failed)) {
    std::string name = entry->path().filename().string();
    std::error_code gone;
    if (!wire::is_valid_id(name) || !entry->is_directory(gone)) continue;
    names.insert(std::move(name));
    if (names.size() > kMostNames) names.erase(std::prev(names.end()));
  }
  if (failed) return std::nullopt;
  return Json{{"names", names}}.dump() + '\n';
}

std::optional<std::string> session_json(const fs::path& folder) {
  const auto summary = read_summary(folder);
  if (!summary) return std::nullopt;
  const auto size_of = [&](std::string_view name) -> Json {
    std::error_code absent;
    const auto bytes = fs::file_size(folder / name, absent);
    return absent ? Json() : Json(bytes);
  };
  const Json json{{"times", size_of(session_names::kTimes)},
                  {"drops", size_of(session_names::kDrops)},
                  {"calibration", size_of(kCameraFile)},
                  {"dropped", summary->totals.named}};
  return json.dump() + '\n';
}

std::string to_prometheus(const Metrics& metrics, RobotMetrics::Time now) {
  std::vector<MetricFamily> families;
  families.push_back(sessions_of(metrics));
  for (const Metric& metric : kMetrics) families.push_back(family_of(metric, metrics, now));
  families.push_back(family_of_streams(
      "orbbuf_samples_total", "Samples taken from the robot in this session", MetricType::Counter,
      metrics, [](const StreamMetrics& stream) { return static_cast<double>(stream.samples); }));
  families.push_back(family_of_streams(
      "orbbuf_samples_lost_total", "Samples that the robot left out", MetricType::Counter, metrics,
      [](const StreamMetrics& stream) { return static_cast<double>(stream.lost); }));
  families.push_back(family_of_streams(
      "orbbuf_robot_waiting_samples", "On the robot, to be sent", MetricType::Gauge, metrics,
      [](const StreamMetrics& stream) { return static_cast<double>(stream.waiting()); }));
  families.push_back(family_of_streams(
      "orbbuf_newest_sample_age_seconds", "Since the newest sample came", MetricType::Gauge,
      metrics, [now](const StreamMetrics& stream) { return to_seconds(now - stream.newest); }));
  families.push_back(of_server("orbbuf_foxglove_viewers", "Foxglove's live connections",
                               MetricType::Gauge, metrics.viewers().open));
  families.push_back(of_server("orbbuf_foxglove_given_up_total",
                               "Messages that they were too slow for", MetricType::Counter,
                               metrics.viewers().given_up));
  std::erase_if(families, [](const MetricFamily& family) { return family.metric.empty(); });
  return prometheus::TextSerializer().Serialize(families);
}

HttpResponse health(const Metrics& metrics) {
  std::string paused;
  for (const auto& [id, robot] : metrics.robots()) {
    if (robot->pause().empty()) continue;
    paused +=
        fmt::format("{} {}: stream paused: {}\n", id, robot->info().session_id, robot->pause());
  }
  if (paused.empty()) return text_response("ok\n");
  HttpResponse response = text_response(std::move(paused));
  response.status = kUnavailable;
  return response;
}

HttpResponse page() {
  static const HttpResponse made = make_page();
  return made;
}

}  // namespace orbbuf
