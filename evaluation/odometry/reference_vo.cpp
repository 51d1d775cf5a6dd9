// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/reference_vo.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <iterator>
#include <utility>

namespace orbbuf::evaluation {
namespace {

constexpr double kSameTimeS = 1e-3;
constexpr double kBetweenKeyframesS = 1;

}  // namespace

double TrackingResult::tracked_share() const {
  const std::size_t counted = frames - starting;
  return counted == 0 ? 0 : 1 - static_cast<double>(unplaced) / static_cast<double>(counted);
}

void ReferenceVo::track(const GrayFrame& frame, std::uint64_t id) {
  ++result_.frames;
  const auto pose = odometry_.track(frame);
  if (pose) {
    is_failing_ = false;
    result_.trajectory.push_back({frame.time_s, *pose});
    return;
  }
  if (odometry_.state() == Odometry::State::kStarting) {
    ++result_.starting;
    return;
  }
  ++result_.unplaced;
  if (!is_failing_) failing_since_ = id;
  is_failing_ = true;
  if (odometry_.state() == Odometry::State::kLost) result_.lost_at = failing_since_;
}

bool reaches(const Trajectory& trajectory, double end_s) {
  return !trajectory.empty() && trajectory.back().time_s >= end_s - kBetweenKeyframesS - kSameTimeS;
}

TrackingResult result_of(Trajectory trajectory, const std::vector<ListedFrame>& frames) {
  TrackingResult result;
  result.frames = frames.size();
  result.trajectory = std::move(trajectory);
  if (result.trajectory.empty()) {
    result.starting = result.frames;
    return result;
  }
  const bool is_lost = !frames.empty() && !reaches(result.trajectory, frames.back().time_s);
  for (const ListedFrame& frame : frames) {
    // The first pose at or behind the frame.
    const auto next = std::ranges::lower_bound(result.trajectory, frame.time_s - kSameTimeS, {},
                                               &StampedPose::time_s);
    if (next == result.trajectory.end()) {
      if (!is_lost) continue;
      ++result.unplaced;
      if (!result.lost_at) result.lost_at = frame.id;
    } else if (next->time_s > frame.time_s + kSameTimeS) {
      if (next == result.trajectory.begin()) {
        ++result.starting;
      } else if (next->time_s - std::prev(next)->time_s > kBetweenKeyframesS + kSameTimeS) {
        ++result.unplaced;
      }
    }
  }
  return result;
}

std::string to_text(const TrackingResult& result, const TrajectoryError& error) {
  auto text = fmt::format("{} frames, {} until the first map, {:.1f} % of the others tracked",
                          result.frames, result.starting, 100 * result.tracked_share());
  if (result.lost_at) text += fmt::format(", lost at frame {}", *result.lost_at);
  if (error.poses >= 3) {
    text += fmt::format(
        "; ATE {:.3f} m of {:.1f} m ({:.2f} %), RPE over 1 s {:.3f} m {:.2f} degrees, scale {:.3f}",
        error.ate_m, error.path_m, error.path_m > 0 ? 100 * error.ate_m / error.path_m : 0,
        error.rpe_m, error.rpe_deg, error.scale);
  }
  return text;
}

}  // namespace orbbuf::evaluation
