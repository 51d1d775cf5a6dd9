// SPDX-License-Identifier: Apache-2.0
#include "server/live/metrics.hpp"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "common/decimal.hpp"
#include "common/seconds.hpp"

namespace orbbuf {
namespace {

using std::chrono::nanoseconds;

constexpr std::chrono::seconds kSilence{1};
constexpr std::chrono::milliseconds kLate{500};
constexpr std::chrono::minutes kMinute{1};
constexpr std::uint64_t kMostParts = 2 * Timeline::kSeconds;
/// Differences of times up to that can be subtracted, too. It is the year 2067.
constexpr std::int64_t kLatest = std::numeric_limits<std::int64_t>::max() / 3;

using Row = std::vector<std::string>;

std::string to_text(std::optional<std::chrono::nanoseconds> age) {
  if (!age) return "-";
  return to_seconds(*age) < 1 ? fmt::format("{:.0f} ms", std::max(0.0, 1e3 * to_seconds(*age)))
                              : fmt::format("{:.1f} s", to_seconds(*age));
}

Row row_of(const RobotMetrics& robot, RobotMetrics::Time now) {
  const bool is_connected = robot.is_connected();
  const bool is_paused = is_connected && !robot.pause().empty();
  Row row{robot.info().robot_id, robot.info().session_id, is_paused ? "paused" : robot.state(),
          fmt::format("{:.1f}", robot.frame_rate(now)),
          robot.is_ended() ? "-" : to_text(robot.timeline().age(now))};
  row.resize(17, "-");
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

/// The first `words` columns are at the left, numbers are at the right.
std::string to_table(const std::vector<Row>& rows, std::size_t words) {
  std::vector<std::size_t> widths(rows.front().size());
  for (const Row& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) widths[i] = std::max(widths[i], row[i].size());
  }
  std::string table;
  for (const Row& row : rows) {
    for (std::size_t i = 0; i < row.size(); ++i) {
      if (i > 0) table += "  ";
      table += i < words ? fmt::format("{:<{}}", row[i], widths[i])
                         : fmt::format("{:>{}}", row[i], widths[i]);
    }
    table += '\n';
  }
  return table;
}

}  // namespace

void Timeline::on_heard(Time now, bool is_new) {
  if (heard_ != Time{} && now - heard_ >= kSilence) {
    silent_since_ = heard_;
    is_silence_over_ = true;
  }
  is_after_connect_ = is_after_connect_ || is_new;
  heard_ = now;
}

void Timeline::on_delivered(std::int64_t capture_time_ns, Time now) {
  const nanoseconds capture(std::clamp(capture_time_ns, -kLatest, kLatest));
  const nanoseconds delay = note_offset(now.time_since_epoch() - capture, now);
  if (is_silence_over_ && (is_after_connect_ || delay >= kLate)) {
    outages_.push_back({robot_time(silent_since_), robot_time(now)});
    if (outages_.size() > kOutages) outages_.pop_front();
  }
  is_silence_over_ = is_after_connect_ = false;
  newest_ = capture;
  TimelineSecond& second = *second_of(capture.count(), true);
  ++second.delivered;
  const auto delay_ms = std::chrono::duration_cast<std::chrono::milliseconds>(delay).count();
  second.delay_ms =
      std::max(second.delay_ms, static_cast<std::uint32_t>(std::clamp<std::int64_t>(
                                    delay_ms, 0, std::numeric_limits<std::uint32_t>::max())));
  second.changed = now;
}

/// In at most kMostParts parts, since a robot may claim any number of frames.
void Timeline::on_dropped(const DropRecord& record, Time now) {
  const std::uint64_t part = (record.frames - 1) / kMostParts + 1;
  for (std::uint64_t done = 0; done < record.frames; done += std::min(part, record.frames - done)) {
    const std::int64_t time_ns = record.capture_time_of(record.sequence + done);
    TimelineSecond* const second = second_of(std::clamp(time_ns, -kLatest, kLatest), false);
    if (second == nullptr) continue;
    second->dropped += static_cast<std::uint32_t>(std::min(part, record.frames - done));
    second->similarity = std::min(second->similarity, record.similarity);
    second->changed = now;
  }
}

nanoseconds Timeline::robot_time(Time time) const {
  const nanoseconds offset = std::min(offset_, offset_before_);
  return offset == kNone ? nanoseconds(0) : time.time_since_epoch() - offset;
}

std::optional<nanoseconds> Timeline::age(Time now) const {
  if (!newest_) return std::nullopt;
  return robot_time(now) - *newest_;
}

/// How much later than the fastest a frame of that `offset` comes. What was least long ago does not
/// count forever, since clocks drift and are set.
nanoseconds Timeline::note_offset(nanoseconds offset, Time now) {
  if (now - minute_ >= kMinute) {
    minute_ = now;
    offset_before_ = offset_;
    offset_ = kNone;
  }
  offset_ = std::min(offset_, offset);
  return offset - std::min(offset_, offset_before_);
}

/// Null for what is too old. A frame in order that is far from the others shows that the robot's
/// clock was set: the others no longer mean anything.
TimelineSecond* Timeline::second_of(std::int64_t capture_time_ns, bool is_in_order) {
  const std::int64_t second = split_seconds(capture_time_ns).seconds;
  const std::int64_t newest = seconds_.empty() ? second : seconds_.back().second;
  const bool is_far = second > newest + kSeconds || second <= newest - kSeconds;
  if (is_far && !is_in_order) return nullptr;
  if (is_far) seconds_.clear();
  const auto after = std::ranges::upper_bound(seconds_, second, {}, &TimelineSecond::second);
  if (after != seconds_.begin() && std::prev(after)->second == second) return &*std::prev(after);
  seconds_.insert(after, TimelineSecond{second});
  while (seconds_.back().second - seconds_.front().second >= kSeconds) seconds_.pop_front();
  return &*std::ranges::lower_bound(seconds_, second, {}, &TimelineSecond::second);
}

std::string to_table(const Metrics& metrics, RobotMetrics::Time now) {
  std::vector<Row> robots{{"ROBOT", "SESSION", "STATE", "FRAMES/S", "AGE", "BUFFER", "LINK",
                           "ROUND TRIP", "CAPTURED", "DELIVERED", "DROPPED", "SKIPPED", "FAILED",
                           "LATE", "ON ROBOT", "QUALITY", "REDUCED"}};
  std::vector<Row> streams{
      {"ROBOT", "STREAM", "SAMPLES/S", "AGE", "CAPTURED", "DELIVERED", "WAITING", "LOST"}};
  std::string pauses;
  for (const auto& [id, robot] : metrics.robots()) {
    if (!robot->pause().empty()) pauses += fmt::format("\n{}: paused: {}\n", id, robot->pause());
    robots.push_back(row_of(*robot, now));
    for (const auto& [name, stream] : robot->streams()) {
      const bool is_over = robot->is_ended();
      streams.push_back({id, name, fmt::format("{:.1f}", is_over ? 0 : stream.rate.per_second(now)),
                         is_over ? "-" : to_text(stream.age(now)), std::to_string(stream.captured),
                         std::to_string(stream.samples), std::to_string(stream.waiting()),
                         std::to_string(stream.lost)});
    }
  }
  return to_table(robots, 3) + (streams.size() > 1 ? '\n' + to_table(streams, 2) : "") + pauses;
}

std::optional<nanoseconds> StreamMetrics::age(EventRate::Time now) const {
  return samples > 0 ? std::optional<nanoseconds>(now - newest) : std::nullopt;
}

void RobotMetrics::on_connected(Time now) {
  is_connected_ = true;
  ++connections_;
  timeline_.on_heard(now, connections_ > 1);
  tell_state();
}

void RobotMetrics::on_disconnected() {
  is_connected_ = false;
  tell_state();
}

void RobotMetrics::on_report(const wire::Report& report, Time now) {
  report_ = report;
  report_time_ = now;
  timeline_.on_heard(now, false);
  for (const wire::StreamDeclaration& stream : info_.streams) {
    streams_[stream.name].captured = report.captured_items[stream.id];
  }
  tell_state();
}

void RobotMetrics::on_delivered(FramePtr frame, Time now) {
  ++frames_;
  bytes_ += frame->jpeg.size();
  if (frame->is_reduced()) ++reduced_;
  quality_ = frame->quality;
  rate_.count(1, now);
  timeline_.on_heard(now, false);
  timeline_.on_delivered(frame->capture_time_ns, now);
  if (const auto watcher = watcher_.lock()) watcher->on_frame(*this, *frame);
  if (keeps_frame_) newest_ = std::move(frame);
}

void RobotMetrics::on_dropped(std::span<const DropRecord> records, Time now) {
  timeline_.on_heard(now, false);
  for (const DropRecord& record : records) {
    drops_ += record.frames;
    timeline_.on_dropped(record, now);
  }
  if (const auto watcher = watcher_.lock()) watcher->on_drops(*this, records);
}

void RobotMetrics::on_samples(const std::string& name, std::uint64_t expected, std::uint64_t first,
                              std::span<const Sample> samples, Time now) {
  timeline_.on_heard(now, false);
  StreamMetrics& stream = streams_[name];
  stream.next = first + samples.size();
  stream.samples += samples.size();
  stream.lost += first - expected;
  stream.rate.count(samples.size(), now);
  stream.newest = now;
  for (std::uint64_t lost = first - expected; const Sample& sample : samples) {
    note(stream, sample, std::exchange(lost, 0), now);
  }
}

/// The robot's clock may have been set: then the seconds before no longer mean anything.
void RobotMetrics::note(StreamMetrics& stream, const Sample& sample, std::uint64_t lost, Time now) {
  constexpr double kFastest = 1e6;
  const std::int64_t time_ns = std::clamp(sample.time_ns, -kLatest, kLatest);
  const std::int64_t second_of = split_seconds(time_ns).seconds;
  auto& seconds = stream.seconds;
  std::int64_t gap_ns = seconds.empty() ? 0 : time_ns - stream.newest_time_ns;
  if (gap_ns < 0 || (!seconds.empty() && second_of >= seconds.back().second + Timeline::kSeconds)) {
    seconds.clear();
    gap_ns = 0;
  }
  stream.newest_time_ns = time_ns;
  if (seconds.empty() || seconds.back().second != second_of) seconds.push_back({second_of});
  while (seconds.front().second <= second_of - Timeline::kSeconds) seconds.pop_front();
  SampleSecond& second = seconds.back();
  ++second.samples;
  second.lost += static_cast<std::uint32_t>(lost);
  second.longest_gap_ms =
      std::max(second.longest_gap_ms, static_cast<std::uint32_t>(gap_ns / 1'000'000));
  const auto& [x, y, z] = sample.angular_velocity;
  second.fastest_turn = std::max(second.fastest_turn,
                                 std::min(std::hypot(x, y, z) * 180 / std::numbers::pi, kFastest));
  second.changed = now;
}

void RobotMetrics::on_late(bool is_present_session) {
  if (is_present_session) ++late_;
  ++late_total_;
}

void RobotMetrics::follow(const RobotMetrics& before) {
  late_total_ = before.late_total_;
  if (before.on_robot_) on_robot_ = {0, before.on_robot_->all};
}

void RobotMetrics::on_ended(Time now) {
  pause_.clear();
  is_connected_ = false;
  ended_ = now;
  tell_state();
}

void RobotMetrics::tell_state() const {
  if (const auto watcher = watcher_.lock()) watcher->on_state(*this);
}

std::string RobotMetrics::state() const {
  if (is_ended()) return "ended";
  return is_connected_ ? "connected" : "disconnected";
}

std::shared_ptr<RobotMetrics> Metrics::begin(const SessionInfo& info) {
  auto metrics = std::make_shared<RobotMetrics>(info, keep_frames_, watcher_);
  auto& latest = robots_[info.robot_id];
  if (latest) metrics->follow(*latest);
  latest = metrics;
  while (robots_.size() > max_robots_) {
    const auto gone = std::ranges::min_element(robots_, {}, [](const auto& entry) {
      return entry.second->ended_at().value_or(RobotMetrics::Time::max());
    });
    if (!gone->second->is_ended()) break;
    robots_.erase(gone);
  }
  if (const auto watcher = watcher_.lock()) watcher->on_begun(*metrics);
  return metrics;
}

}  // namespace orbbuf
