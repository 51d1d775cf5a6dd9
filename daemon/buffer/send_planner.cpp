// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/send_planner.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <limits>
#include <utility>

namespace orbbuf {
namespace {

constexpr double kWeightOfNew = 0.1;       // in the means of interval and bytes
constexpr double kLongestInterval = 4;     // counted of one step, as a multiple of the mean
constexpr double kRoom = 1.001;            // a step of n frames may be that much longer than it
constexpr double kFramesRoom = 0.2;        // and frames to come that much further apart, of one
constexpr int kHalvings = 20;              // a millionth of the range
constexpr double kShortestHorizon = 0.25;  // of live_again: left to plan for when late

double seconds(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace

/// What would be sent, one frame after the other.
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
  std::size_t choice = 0;
  if (!last) {
    choice = first_to_send(waiting);
  } else if (waiting.size() > 1 && moment.bytes_per_s > 0) {
    step_s_ = moment.end ? last_step(*last, waiting, moment) : next_step(*last, waiting, moment);
    choice = chain(*last, waiting, step_s_, moment).first;
  }
  if (moment.bytes_per_s > 0) {
    expected_s_ = static_cast<double>(waiting[choice].bytes) / moment.bytes_per_s;
  }
  return choice;
}

/// The smallest that is live by the deadline. What was planned for holds near the deadline and
/// behind it, where a few sends too many or too few would ask for leaps: to be somewhat late is
/// better.
double SendPlanner::next_step(double last, std::span<const PlannedFrame> waiting,
                              const SendMoment& moment) const {
  const double left_s = seconds(*deadline_ - moment.now);
  const double least_s = kShortestHorizon * seconds(settings_.live_again);
  const double step = smallest_step(last, waiting, left_s, moment);
  if (step <= step_s_ || left_s >= least_s) return step;
  return std::max(step_s_, smallest_step(last, waiting, least_s, moment));
}

/// Nothing more will be captured: the smallest with which all of the chain is sent in time.
double SendPlanner::last_step(double last, std::span<const PlannedFrame> waiting,
                              const SendMoment& moment) const {
  return smallest_step(last, waiting, seconds(*moment.end - moment.now), moment);
}

/// With which the chain is live within the horizon; if there is none, the largest one.
double SendPlanner::smallest_step(double last, std::span<const PlannedFrame> waiting,
                                  double horizon_s, const SendMoment& moment) const {
  const auto is_enough = [&](double step_s) {
    return chain(last, waiting, step_s, moment).live_s <= horizon_s;
  };
  double too_small = 0;
  double step = moment.end ? waiting.back().position_s - last
                           : std::max(seconds(settings_.largest_step), 2 * kRoom * interval_s_);
  if (is_enough(0)) return 0;
  if (!is_enough(step)) return step;
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = (too_small + step) / 2;
    (is_enough(middle) ? step : too_small) = middle;
  }
  return step;
}

/// The deadline is set where waiting begins, and again where sending goes on after it stood still
/// for longer than the frame before can have taken.
void SendPlanner::look_for_return(std::size_t waiting, const SendMoment& moment) {
  const auto before = std::exchange(last_choice_, moment.now);
  if (waiting == 1) {
    deadline_.reset();
    step_s_ = 0;
    return;
  }
  const double pause_s = before ? seconds(moment.now - *before) : 0;
  if (!deadline_ || pause_s > 2 * (expected_s_ + interval_s_)) {
    deadline_ = moment.now + settings_.live_again;
    step_s_ = 0;
  }
}

/// Nothing is torn by what is missing before the first frame of all: so begin as late as the
/// stream may be.
std::size_t SendPlanner::first_to_send(std::span<const PlannedFrame> waiting) const {
  const double earliest_s = waiting.back().position_s - seconds(settings_.live_again);
  const auto first = std::ranges::lower_bound(waiting, earliest_s, {}, &PlannedFrame::position_s);
  return static_cast<std::size_t>(first - waiting.begin());
}

/// Each frame is the farthest that a step reaches, or the next. Of those still to come, sizes and
/// intervals are taken to be the mean ones.
SendPlanner::Chain SendPlanner::chain(double last, std::span<const PlannedFrame> waiting,
                                      double largest_step_s, const SendMoment& moment) const {
  Chain chain;
  double time_s = 0;  // at which the frame at hand is sent
  for (std::size_t i = 0; i < waiting.size();) {
    while (i + 1 < waiting.size() && waiting[i + 1].position_s - last <= largest_step_s) ++i;
    if (time_s == 0) chain.first = i;
    last = waiting[i].position_s;
    chain.live_s = time_s;
    time_s += static_cast<double>(waiting[i].bytes) / moment.bytes_per_s;
    ++i;
  }
  if (moment.end) {
    chain.live_s = time_s;
    return chain;
  }
  if (interval_s_ <= 0) return chain;
  // Captured while the newest that waits now is reached, less what each send from there on gains.
  const double behind = chain.live_s / interval_s_;
  const double sent_at_once = std::max(1.0, std::floor(largest_step_s / interval_s_ + kFramesRoom));
  const double send_s = mean_bytes_ / moment.bytes_per_s;
  const double gained = sent_at_once - send_s / interval_s_;
  if (behind < 1) return chain;
  if (gained <= 0) {
    chain.live_s = std::numeric_limits<double>::infinity();
  } else {
    chain.live_s += std::ceil((behind - 1) / gained) * send_s;
  }
  return chain;
}

}  // namespace orbbuf
