// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/verdict.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <iterator>
#include <utility>

namespace orbbuf::evaluation {
namespace {

constexpr double kSameTimeS = 1e-3;
constexpr double kBetweenKeyframesS = 1;

}  // namespace

double Verdict::tracked_share() const {
  const std::size_t judged = frames - starting;
  return judged == 0 ? 0 : 1 - static_cast<double>(unplaced) / static_cast<double>(judged);
}

void Judge::see(const JudgedFrame& frame, std::uint64_t id) {
  ++verdict_.frames;
  const auto pose = odometry_.track(frame);
  if (pose) {
    is_failing_ = false;
    verdict_.trajectory.push_back({frame.time_s, *pose});
    return;
  }
  if (odometry_.state() == Odometry::State::kStarting) {
    ++verdict_.starting;
    return;
  }
  ++verdict_.unplaced;
  if (!is_failing_) failing_since_ = id;
  is_failing_ = true;
  if (odometry_.state() == Odometry::State::kLost) verdict_.lost_at = failing_since_;
}

bool reaches(const Trajectory& trajectory, double end_s) {
  return !trajectory.empty() && trajectory.back().time_s >= end_s - kBetweenKeyframesS - kSameTimeS;
}

Verdict verdict_of(Trajectory trajectory, const std::vector<ListedFrame>& frames) {
  Verdict verdict;
  verdict.frames = frames.size();
  verdict.trajectory = std::move(trajectory);
  if (verdict.trajectory.empty()) {
    verdict.starting = verdict.frames;
    return verdict;
  }
  const bool is_lost = !frames.empty() && !reaches(verdict.trajectory, frames.back().time_s);
  for (const ListedFrame& frame : frames) {
    // The first pose at or behind the frame.
    const auto next = std::ranges::lower_bound(verdict.trajectory, frame.time_s - kSameTimeS, {},
                                               &StampedPose::time_s);
    if (next == verdict.trajectory.end()) {
      if (!is_lost) continue;
      ++verdict.unplaced;
      if (!verdict.lost_at) verdict.lost_at = frame.id;
    } else if (next->time_s > frame.time_s + kSameTimeS) {
      if (next == verdict.trajectory.begin()) {
        ++verdict.starting;
      } else if (next->time_s - std::prev(next)->time_s > kBetweenKeyframesS + kSameTimeS) {
        ++verdict.unplaced;
      }
    }
  }
  return verdict;
}

std::string to_text(const Verdict& verdict, const TrajectoryError& error) {
  auto text = fmt::format("{} frames, {} until the first map, {:.1f} % of the others tracked",
                          verdict.frames, verdict.starting, 100 * verdict.tracked_share());
  if (verdict.lost_at) text += fmt::format(", lost at frame {}", *verdict.lost_at);
  if (error.poses >= 3) {
    text += fmt::format(
        "; ATE {:.3f} m of {:.1f} m ({:.2f} %), RPE over 1 s {:.3f} m {:.2f} degrees, scale {:.3f}",
        error.ate_m, error.path_m, error.path_m > 0 ? 100 * error.ate_m / error.path_m : 0,
        error.rpe_m, error.rpe_deg, error.scale);
  }
  return text;
}

}  // namespace orbbuf::evaluation
