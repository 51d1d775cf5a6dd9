// SPDX-License-Identifier: Apache-2.0
#include "evaluation/outages/judge.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace orbbuf::evaluation {
namespace {

/// Whether the program lost track of the camera after the return, and whether it tracks it at the
/// end.
struct Tracking {
  bool has_paused = false;
  bool is_at_end = false;
};

/// A pause is more than `lost_s` without a pose in which frames of the list were captured after the
/// outage's begin.
Tracking tracking_of(const OutageList& list, const Trajectory& estimate, double lost_s) {
  Tracking tracking;
  double missed_s = 0;
  const ListedArrival* last_missed = nullptr;
  for (const ListedArrival& arrival : list.arrivals) {
    if (pose_at(estimate, arrival.capture_s)) {
      last_missed = nullptr;
      missed_s = 0;
      continue;
    }
    if (last_missed) missed_s += arrival.capture_s - last_missed->capture_s;
    last_missed = &arrival;
    if (missed_s > lost_s && arrival.capture_s > list.begin_s) tracking.has_paused = true;
  }
  tracking.is_at_end = !estimate.empty() && !list.arrivals.empty() &&
                       estimate.back().time_s >= list.arrivals.back().capture_s - lost_s;
  return tracking;
}

}  // namespace

std::optional<double> turn_error_deg(const Trajectory& estimate, const Trajectory& truth,
                                     double from_s, double to_s) {
  const auto after = std::ranges::upper_bound(estimate, from_s, {}, &StampedPose::time_s);
  const auto end = std::ranges::lower_bound(estimate, to_s, {}, &StampedPose::time_s);
  if (after == estimate.begin() || end == estimate.end()) return std::nullopt;
  const StampedPose& before = *(after - 1);
  const StampedPose* true_before = pose_at(truth, before.time_s);
  const StampedPose* true_end = pose_at(truth, end->time_s);
  if (!true_before || !true_end) return std::nullopt;
  const Eigen::Quaterniond turn(before.pose.rotation().transpose() * end->pose.rotation());
  const Eigen::Quaterniond true_turn(true_before->pose.rotation().transpose() *
                                     true_end->pose.rotation());
  return turn.angularDistance(true_turn) * 180 / std::numbers::pi;
}

Judgement judge(const OutageList& list, const Trajectory& estimate, const Trajectory& unbroken,
                const Trajectory& truth, const Criteria& criteria) {
  const double until_s = list.return_s() + list.lateness_s;
  const Tracking tracking = tracking_of(list, estimate, criteria.lost_s);
  Judgement judgement;
  judgement.is_tracked = tracking.is_at_end && !tracking.has_paused;
  judgement.error = compare(estimate, truth, criteria.is_mono);
  judgement.unbroken_ate_m = compare(unbroken, truth, criteria.is_mono).ate_m;
  judgement.unbroken_turn_deg = turn_error_deg(unbroken, truth, list.begin_s, until_s).value_or(0);
  const auto turn = turn_error_deg(estimate, truth, list.begin_s, until_s);
  judgement.turn_deg = turn.value_or(0);
  const bool is_exact =
      judgement.error.poses >= 3 && turn &&
      *turn <= judgement.unbroken_turn_deg + criteria.turn_deg &&
      judgement.error.ate_m <=
          std::max(criteria.ate_floor, criteria.ate_ratio * judgement.unbroken_ate_m);
  judgement.is_survived = judgement.is_tracked && is_exact;
  judgement.is_relocalised = tracking.is_at_end && tracking.has_paused && is_exact;
  return judgement;
}

double Paired::p_value() const {
  const std::size_t n = only_first + only_second;
  double tail = 0;
  double term = std::pow(0.5, n);
  for (std::size_t k = 0; k <= std::min(only_first, only_second); ++k) {
    tail += term;
    term *= static_cast<double>(n - k) / static_cast<double>(k + 1);
  }
  return std::min(1.0, 2 * tail);
}

Share share_of(const Survived& survived) {
  const auto some = std::ranges::count_if(survived, [](const auto& place) { return place.second; });
  return {static_cast<std::size_t>(some), survived.size()};
}

Paired compare_places(const Survived& first, const Survived& second) {
  Paired paired;
  for (const auto& [place, is_survived] : first) {
    const auto other = second.find(place);
    if (other == second.end()) continue;
    ++(is_survived     ? other->second ? paired.both : paired.only_first
       : other->second ? paired.only_second
                       : paired.neither);
  }
  return paired;
}

}  // namespace orbbuf::evaluation
