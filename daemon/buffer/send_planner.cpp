// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/send_planner.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <utility>

#include "common/seconds.hpp"

namespace orbbuf {
namespace {

constexpr double kWeightOfNew = 0.1;    // in the means of interval and bytes
constexpr double kLongestInterval = 4;  // counted of one step, as a multiple of the mean
constexpr double kRoom = 1.001;         // a step of n frames may be that much longer than it
constexpr double kJitter = 0.2;         // of an interval: that much late may be what is to come
constexpr double kDrift = 0.01;         // of an interval that the clocks drift apart in a frame
constexpr double kTolerance = 0.5;      // of an interval: the deadline is met to the nearest frame
constexpr int kHalvings = 20;           // a millionth of the range
constexpr double kShortestHorizon = 0.15;  // of live_again: left to plan for when late

}  // namespace

/// Frames that could be sent, one after the other.
struct SendPlanner::Chain {
  std::size_t first = 0;  ///< index of its first frame
  double live_s = 0;      ///< from now until it has caught up with the camera; infinite: never
};

void SendPlanner::on_captured(double step_s, std::size_t bytes) {
  const auto size = static_cast<double>(bytes);
  if (mean_bytes_ == 0) mean_bytes_ = size;
  mean_bytes_ += kWeightOfNew * (size - mean_bytes_);
  if (step_s <= 0) return;
  if (interval_s_ == 0) interval_s_ = step_s;
  interval_s_ += kWeightOfNew * (std::min(step_s, kLongestInterval * interval_s_) - interval_s_);
}

std::size_t SendPlanner::choose(std::optional<double> last, std::span<const PlannedFrame> waiting,
                                const SendMoment& moment) {
  assert(!waiting.empty());
  look_for_return(waiting.size(), moment);
  note_phase(waiting, moment);
  std::size_t choice = 0;
  if (!last) {
    choice = first_to_send(waiting);
  } else if (waiting.size() > 1 && moment.bytes_per_s > 0) {
    const double step_s =
        moment.end ? smallest_step(*last, waiting, to_seconds(*moment.end - moment.now), moment)
                   : next_step(*last, waiting, moment);
    choice = chain(*last, waiting, step_s, 0, moment).first;
  }
  if (moment.bytes_per_s > 0) {
    expected_s_ = static_cast<double>(waiting[choice].bytes) / moment.bytes_per_s;
  }
  return choice;
}

/// The smallest step that is live by the deadline. Near the deadline and after it, a few sends too
/// few would need a large step. There no step is longer than the largest one that was needed
/// before, and the stream is late instead.
double SendPlanner::next_step(double last, std::span<const PlannedFrame> waiting,
                              const SendMoment& moment) {
  const double left_s = to_seconds(*deadline_ - moment.now) + kTolerance * interval_s_;
  const double least_s = kShortestHorizon * to_seconds(settings_.live_again);
  const double step = smallest_step(last, waiting, left_s, moment);
  if (step > largest_so_far_s_ && left_s < least_s) {
    return std::max(largest_so_far_s_, smallest_step(last, waiting, least_s, moment));
  }
  largest_so_far_s_ = std::max(largest_so_far_s_, step);
  return step;
}

/// The smallest step with which the chain is live within the horizon, or, after the last capture,
/// ends within it. The largest one if there is none.
double SendPlanner::smallest_step(double last, std::span<const PlannedFrame> waiting,
                                  double horizon_s, const SendMoment& moment) const {
  const auto is_enough = [&](double step_s) {
    return chain(last, waiting, step_s, horizon_s, moment).live_s <= horizon_s;
  };
  double too_small = 0;
  double step = moment.end ? waiting.back().position_s - last
                           : std::max(to_seconds(settings_.largest_step), 2 * kRoom * interval_s_);
  if (is_enough(0)) return 0;
  if (!is_enough(step)) return step;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = (too_small + step) / 2;
    (is_enough(middle) ? step : too_small) = middle;
  }
  return step;
}

/// Sets the deadline when frames begin to wait, and again when sending continues after a pause
/// that was longer than the last frame can have taken.
void SendPlanner::look_for_return(std::size_t waiting, const SendMoment& moment) {
  const auto before = std::exchange(last_choice_, moment.now);
  if (waiting == 1) {
    deadline_.reset();
    largest_so_far_s_ = 0;
    return;
  }
  const double pause_s = before ? to_seconds(moment.now - *before) : 0;
  if (!deadline_ || pause_s > 2 * (expected_s_ + interval_s_)) {
    deadline_ = moment.now + settings_.live_again;
    largest_so_far_s_ = 0;
  }
}

/// A frame that does not wait is taken when it is captured: this relates the two clocks.
void SendPlanner::note_phase(std::span<const PlannedFrame> waiting, const SendMoment& moment) {
  const double offset_s = to_seconds(moment.now) - waiting.back().position_s;
  if (waiting.size() == 1) offset_s_ = std::min(offset_s, offset_s_ + kDrift * interval_s_);
  next_capture_s_ = std::clamp(interval_s_ - (offset_s - offset_s_), 0.0, interval_s_);
}

/// No step comes before the first send, so it may skip frames: to the oldest one that is at most
/// live_again older than the newest.
std::size_t SendPlanner::first_to_send(std::span<const PlannedFrame> waiting) const {
  const double earliest_s = waiting.back().position_s - to_seconds(settings_.live_again);
  const auto first = std::ranges::lower_bound(waiting, earliest_s, {}, &PlannedFrame::position_s);
  return static_cast<std::size_t>(first - waiting.begin());
}

/// Each frame of a chain is the farthest within a step of the last one that is captured by then, or
/// the next one. Frames still to be captured have the mean size and interval.
SendPlanner::Chain SendPlanner::chain(double last, std::span<const PlannedFrame> waiting,
                                      double step_s, double horizon_s,
                                      const SendMoment& moment) const {
  const std::size_t known = waiting.size();
  const auto position_of = [&](std::size_t i) {
    if (i < known) return waiting[i].position_s;
    return waiting.back().position_s + static_cast<double>(i - known + 1) * interval_s_;
  };
  const auto bytes_of = [&](std::size_t i) {
    return i < known ? static_cast<double>(waiting[i].bytes) : mean_bytes_;
  };
  const auto captured_by = [&](double time_s) {
    if (moment.end || interval_s_ <= 0 || time_s <= next_capture_s_) return known;
    return known + 1 + static_cast<std::size_t>((time_s - next_capture_s_) / interval_s_);
  };
  Chain chain{0, std::numeric_limits<double>::infinity()};
  double time_s = 0;  // at which the frame at hand is sent
  for (std::size_t i = 0; time_s <= horizon_s; ++i) {
    const std::size_t count = captured_by(time_s);
    const double reach_s = last + step_s;
    while (i + 1 < count &&
           position_of(i + 1) <= reach_s + (i + 1 < known ? 0 : kJitter * interval_s_)) {
      ++i;
    }
    if (time_s == 0) chain.first = i;
    last = position_of(i);
    if (i + 1 == count && !moment.end) chain.live_s = time_s;
    time_s += bytes_of(i) / moment.bytes_per_s;
    if (i + 1 == count && moment.end) chain.live_s = time_s;
    if (i + 1 == count) break;
  }
  return chain;
}

}  // namespace orbbuf
