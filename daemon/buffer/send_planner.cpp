// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/send_planner.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <utility>

#include "common/seconds.hpp"

namespace orbbuf {
namespace {

constexpr double kWeightOfNew = 0.1;    // in the means of interval and bytes
constexpr double kLongestInterval = 4;  // counted of one step, as a multiple of the mean
constexpr double kRoom = 1.001;         // a step of n frames may be that much longer than it
constexpr double kJitter = 0.2;         // of an interval: that much late may be what is to come
constexpr double kDrift = 0.01;         // of an interval that the clocks drift apart in a frame
constexpr double kTolerance = 0.5;      // the same: the deadline is met to the nearest frame
constexpr int kHalvings = 20;           // a millionth of the range
constexpr double kNearDeadline = 0.15;  // of live_again
constexpr double kAllowance = 0.2;      // the same: later than that, rather than a longer step
constexpr double kLatest = 0.5;         // the same: later than that, and the largest step grows
constexpr double kStretch = 1.25;       // to that
constexpr double kClose = 7.0 / 6;      // ratio of bytes that is not worth the work
constexpr double kFill = 0.9;           // of the link, by frames that are encoded for it
constexpr double kLittleFill = 0.7;     // then it carries a higher quality
constexpr std::chrono::seconds kSlowFor{1};  // until frames are encoded at a lower quality
constexpr std::chrono::seconds kFastFor{3};  // and at a higher one

}  // namespace

/// How to send until the stream is live.
struct SendPlanner::Plan {
  double step_s = 0;  ///< the longest; 0: every frame
  int quality = 0;    ///< the highest
};

/// Frames that could be sent, one after the other.
struct SendPlanner::Chain {
  boost::container::static_vector<std::size_t, Choices::static_capacity> first;  ///< that wait
  double live_s = 0;  ///< from now until it has caught up with the camera; infinite: never
};

SendPlanner::SendPlanner(PlanSettings settings)
    : settings_(settings), least_so_far_(settings.quality), encode_quality_(settings.quality) {
  assert(settings.least_quality <= settings.quality);
}

void SendPlanner::on_captured(double step_s, const PlannedFrame& frame) {
  const double size = static_cast<double>(frame.bytes) / sizes_.share(own_quality(frame));
  if (mean_size_ == 0) mean_size_ = size;
  mean_size_ += kWeightOfNew * (size - mean_size_);
  if (step_s <= 0) return;
  if (interval_s_ == 0) interval_s_ = step_s;
  interval_s_ += kWeightOfNew * (std::min(step_s, kLongestInterval * interval_s_) - interval_s_);
}

SendPlanner::Choices SendPlanner::choose(std::optional<double> last,
                                         std::span<const PlannedFrame> waiting,
                                         const SendMoment& moment) {
  assert(!waiting.empty());
  look_for_return(waiting.size(), moment);
  note_phase(waiting, moment);
  adapt_encoding(moment);
  if (!last) return {{first_to_send(waiting), 0}};
  if (moment.bytes_per_s <= 0) return {{0, 0}};
  const int fitting = fitting_quality(waiting.back(), moment);
  if (waiting.size() == 1 && !moment.end) return {{0, reduced_quality(waiting[0], fitting)}};
  const Plan plan = moment.end
                        ? plan_within(to_seconds(*moment.end - moment.now), *last, waiting, moment)
                        : next_plan(*last, waiting, moment);
  Choices choices;
  for (const std::size_t i : chain(plan, 0, *last, waiting, moment).first) {
    const bool is_newest = i + 1 == waiting.size() && !moment.end;  // others will soon wait for it
    const int quality = is_newest ? std::min(fitting, plan.quality) : plan.quality;
    choices.push_back({i, reduced_quality(waiting[i], quality)});
  }
  return choices;
}

void SendPlanner::on_sent(std::size_t bytes, const SendMoment& moment) {
  if (moment.bytes_per_s > 0) expected_s_ = static_cast<double>(bytes) / moment.bytes_per_s;
}

void SendPlanner::on_reduced(const PlannedFrame& frame, std::size_t bytes, int quality) {
  sizes_.learn(static_cast<double>(frame.bytes), own_quality(frame), static_cast<double>(bytes),
               quality);
}

bool SendPlanner::is_close(int quality, int other) const {
  const double ratio = sizes_.share(quality) / sizes_.share(other);
  return ratio < kClose && ratio > 1 / kClose;
}

double SendPlanner::saved_s(const PlannedFrame& frame, int quality,
                            const SendMoment& moment) const {
  if (moment.bytes_per_s <= 0) return 0;
  const double kept = sizes_.share(quality) / sizes_.share(own_quality(frame));
  return (1 - kept) * static_cast<double>(frame.bytes) / moment.bytes_per_s;
}

int SendPlanner::own_quality(const PlannedFrame& frame) const {
  return frame.quality > 0 ? frame.quality : settings_.quality;
}

/// 0, which is as it is, if the frame has that quality or less, or nearly.
int SendPlanner::reduced_quality(const PlannedFrame& frame, int quality) const {
  const int own = own_quality(frame);
  return quality >= own || is_close(quality, own) ? 0 : quality;
}

/// At which a JPEG has no more than that share of its bytes at quality 50; else the least.
int SendPlanner::highest_quality(double share) const {
  int quality = settings_.quality;
  while (quality > settings_.least_quality && sizes_.share(quality) > share) --quality;
  return quality;
}

/// At which the link sends the frame in the time of one.
int SendPlanner::fitting_quality(const PlannedFrame& frame, const SendMoment& moment) const {
  if (interval_s_ <= 0) return settings_.quality;
  const double room = moment.bytes_per_s * interval_s_ / static_cast<double>(frame.bytes);
  return highest_quality(room * sizes_.share(own_quality(frame)));
}

/// A backlog that can be worked off in as long as it has lasted, with no longer steps, is: lateness
/// costs more than a little quality. A step that was not needed before costs more than a little
/// lateness. Near the deadline, where a few sends too few would need a leap, so does a quality.
SendPlanner::Plan SendPlanner::next_plan(double last, std::span<const PlannedFrame> waiting,
                                         const SendMoment& moment) {
  const double live_again_s = to_seconds(settings_.live_again);
  const double left_s = to_seconds(*deadline_ - moment.now);
  Plan plan = plan_within(left_s, last, waiting, moment);
  const double behind_s = waiting.back().position_s - last;
  const Plan cheapest{whole_frames(plan.step_s), settings_.least_quality};
  const bool is_short =
      behind_s < left_s && chain(cheapest, behind_s, last, waiting, moment).live_s <= behind_s;
  if (is_short) plan = plan_within(behind_s, last, waiting, moment);
  const bool is_near = left_s < kNearDeadline * live_again_s;
  if (plan.step_s > largest_so_far_s_ || (is_near && plan.quality < least_so_far_)) {
    const double later_s = std::max(0.0, left_s) + kAllowance * live_again_s;
    const Plan later = plan_within(later_s, last, waiting, moment);
    plan.step_s = std::max(largest_so_far_s_, std::min(plan.step_s, whole_frames(later.step_s)));
    if (is_near) plan.quality = std::min(least_so_far_, later.quality);
  }
  largest_so_far_s_ = std::max(largest_so_far_s_, plan.step_s);
  least_so_far_ = std::min(least_so_far_, plan.quality);
  return plan;
}

/// The shortest step of whole frames that is not shorter.
double SendPlanner::whole_frames(double step_s) const {
  if (interval_s_ <= 0) return step_s;
  return (std::ceil(step_s / interval_s_ - kJitter) + kJitter) * interval_s_;
}

/// The smallest step with which the chain is live within the horizon, or, after the last capture,
/// ends within it, and then the highest quality. The largest step and the least quality if there is
/// none; a longer step if the stream would be very late.
SendPlanner::Plan SendPlanner::plan_within(double horizon_s, double last,
                                           std::span<const PlannedFrame> waiting,
                                           const SendMoment& moment) const {
  double end_s = horizon_s + (moment.end ? 0 : kTolerance * interval_s_);
  const auto is_enough = [&](const Plan& plan) {
    return chain(plan, end_s, last, waiting, moment).live_s <= end_s;
  };
  Plan plan{0, settings_.least_quality};
  if (!is_enough(plan)) {
    double too_small = 0;
    plan.step_s = moment.end
                      ? waiting.back().position_s - last
                      : std::max(to_seconds(settings_.largest_step), 2 * kRoom * interval_s_);
    if (!is_enough(plan)) {
      end_s += kLatest * to_seconds(settings_.live_again);
      if (!moment.end && !is_enough(plan)) plan.step_s *= kStretch;
      return plan;
    }
    for (int i = 0; i < kHalvings; ++i) {
      const double middle = (too_small + plan.step_s) / 2;
      (is_enough({middle, plan.quality}) ? plan.step_s : too_small) = middle;
    }
  }
  end_s = horizon_s;
  for (int too_high = settings_.quality + 1; too_high - plan.quality > 1;) {
    const int middle = (too_high + plan.quality) / 2;
    (is_enough({plan.step_s, middle}) ? plan.quality : too_high) = middle;
  }
  return plan;
}

/// Sets the deadline when frames begin to wait, and again when sending continues after a pause
/// that was longer than the last frame can have taken.
void SendPlanner::look_for_return(std::size_t waiting, const SendMoment& moment) {
  const auto before = std::exchange(last_choice_, moment.now);
  const double pause_s = before ? to_seconds(moment.now - *before) : 0;
  const bool is_return = pause_s > 2 * (expected_s_ + interval_s_);
  if (is_return) unfit_since_.reset();
  if (waiting == 1) {
    deadline_.reset();
  } else if (!deadline_ || is_return) {
    deadline_ = moment.now + settings_.live_again;
  } else {
    return;
  }
  largest_so_far_s_ = 0;
  least_so_far_ = settings_.quality;
}

/// A frame that does not wait is taken when it is captured: this relates the two clocks.
void SendPlanner::note_phase(std::span<const PlannedFrame> waiting, const SendMoment& moment) {
  const double offset_s = to_seconds(moment.now) - waiting.back().position_s;
  if (waiting.size() == 1) offset_s_ = std::min(offset_s, offset_s_ + kDrift * interval_s_);
  next_capture_s_ = std::clamp(interval_s_ - (offset_s - offset_s_), 0.0, interval_s_);
}

/// Not at once, and with a margin either way, so that the quality does not flicker.
void SendPlanner::adapt_encoding(const SendMoment& moment) {
  const double room = moment.bytes_per_s * interval_s_;
  if (room <= 0 || mean_size_ <= 0) return;
  const double fill = mean_bytes() / room;
  const bool is_slow = fill > 1 && encode_quality_ > settings_.least_quality;
  const bool is_fast = fill < kLittleFill && encode_quality_ < settings_.quality;
  if (!is_slow && !is_fast) return unfit_since_.reset();
  if (!unfit_since_) unfit_since_ = moment.now;
  if (moment.now - *unfit_since_ < (is_slow ? kSlowFor : kFastFor)) return;
  unfit_since_.reset();
  encode_quality_ = highest_quality(kFill * room / mean_size_);
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
SendPlanner::Chain SendPlanner::chain(const Plan& plan, double horizon_s, double last,
                                      std::span<const PlannedFrame> waiting,
                                      const SendMoment& moment) const {
  const std::size_t known = waiting.size();
  const auto position_of = [&](std::size_t i) {
    if (i < known) return waiting[i].position_s;
    return waiting.back().position_s + static_cast<double>(i - known + 1) * interval_s_;
  };
  const double expected_bytes = mean_size_ * sizes_.share(std::min(plan.quality, encode_quality_));
  int quality = -1;  // the last frame's own
  double kept = 1;   // of its bytes
  const auto bytes_of = [&](std::size_t i) {
    if (i >= known) return expected_bytes;
    if (std::exchange(quality, waiting[i].quality) != waiting[i].quality) {
      const int reduced = reduced_quality(waiting[i], plan.quality);
      kept = reduced == 0 ? 1 : sizes_.share(reduced) / sizes_.share(own_quality(waiting[i]));
    }
    return kept * static_cast<double>(waiting[i].bytes);
  };
  const auto captured_by = [&](double time_s) {
    if (moment.end || interval_s_ <= 0 || time_s <= next_capture_s_) return known;
    return known + 1 + static_cast<std::size_t>((time_s - next_capture_s_) / interval_s_);
  };
  Chain chain{{}, std::numeric_limits<double>::infinity()};
  const auto is_foreseen = [&](std::size_t i) {
    return i < known && chain.first.size() < chain.first.capacity();
  };
  double time_s = 0;  // at which the frame at hand is sent
  for (std::size_t i = 0; time_s <= horizon_s || is_foreseen(i); ++i) {
    const std::size_t count = captured_by(time_s);
    const double reach_s = last + plan.step_s;
    while (i + 1 < count &&
           position_of(i + 1) <= reach_s + (i + 1 < known ? 0 : kJitter * interval_s_)) {
      ++i;
    }
    if (is_foreseen(i)) chain.first.push_back(i);
    last = position_of(i);
    if (i + 1 == count && !moment.end) chain.live_s = time_s;
    time_s += bytes_of(i) / moment.bytes_per_s;
    if (i + 1 == count && moment.end) chain.live_s = time_s;
    if (i + 1 == count) break;
  }
  return chain;
}

namespace {

constexpr double kWeightOfSeen = 0.1;
constexpr double kLeastExponent =
    0.2;  // a result beyond these is an odd image, such as a black one
constexpr double kMostExponent = 1.0;
constexpr double kLeastRatio = 1.2;  // of the steps: closer ones say little of the exponent

/// The step of libjpeg's quantisation tables at `quality`, as a multiple of that at 50. Those at
/// 100 have steps of 1, about 1/30.
double step_at(int quality) {
  if (quality < 50) return 50.0 / quality;
  return std::max(2.0 - quality / 50.0, 1.0 / 30);
}

}  // namespace

double SizeModel::share(int quality) const { return std::pow(step_at(quality), -exponent_); }

void SizeModel::learn(double bytes, int from, double reduced_bytes, int to) {
  const double ratio = step_at(to) / step_at(from);
  if (ratio < kLeastRatio || bytes <= 0 || reduced_bytes <= 0) return;
  const double seen = std::log(bytes / reduced_bytes) / std::log(ratio);
  exponent_ += kWeightOfSeen * (std::clamp(seen, kLeastExponent, kMostExponent) - exponent_);
}

}  // namespace orbbuf
