// SPDX-License-Identifier: Apache-2.0
#include "server/live/metrics.hpp"

#include <algorithm>
#include <utility>

namespace orbbuf {
namespace {

constexpr std::chrono::seconds kCounting{1};

}  // namespace

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
  tell_state();
}

void RobotMetrics::on_delivered(FramePtr frame, Time now) {
  ++frames_;
  bytes_ += frame->jpeg.size();
  if (frame->is_reduced()) ++reduced_;
  quality_ = frame->quality;
  if (now - counting_since_ >= kCounting) {
    last_rate_ = frame_rate(now);
    counting_since_ = now;
    counted_ = 0;
  }
  ++counted_;
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

double RobotMetrics::frame_rate(Time now) const {
  if (ended_) return 0;
  const std::chrono::duration<double> time = now - counting_since_;
  return time < kCounting ? last_rate_ : counted_ / time.count();
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
