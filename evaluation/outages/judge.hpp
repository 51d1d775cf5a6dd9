// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "evaluation/odometry/trajectory.hpp"
#include "evaluation/outages/outage_list.hpp"
#include "evaluation/trial/report.hpp"

namespace orbbuf::evaluation {

/// When an outage counts as survived.
struct Criteria {
  double ate_ratio = 3;  ///< ATE at most so many times the unbroken run's
  double ate_floor = 0;  ///< or at most that; for a reference that is the unbroken run itself
  double turn_deg =
      6;  ///< error of the rotation over the outage at most so much more than the unbroken run's
  double lost_s = 1;    ///< tracked until so long before the last frame, and without a longer pause
                        ///< after the return
  bool is_mono = true;  ///< the estimate's scale is not known
};

/// What a SLAM program made of the frames of a list.
struct Judgement {
  bool is_survived = false;
  bool is_tracked = false;  ///< to the end, and without a pause
  bool is_relocalised =
      false;  ///< paused, but tracked at the end, and its ATE and rotation are survived
  TrajectoryError error;
  double turn_deg = 0;  ///< error of the rotation over the outage
  double unbroken_ate_m = 0;
  double unbroken_turn_deg = 0;
};

/// `estimate`: of the frames of the list; `unbroken`: of the same program, of all frames. Times are
/// capture times of what is played. `truth` may be the unbroken run.
Judgement judge(const OutageList& list, const Trajectory& estimate, const Trajectory& unbroken,
                const Trajectory& truth, const Criteria& criteria);

/// The angle between the estimate's and the truth's rotation from the last pose at or before
/// `from_s` to the first at or after `to_s`, in degrees; nothing if there are no such poses.
std::optional<double> turn_error_deg(const Trajectory& estimate, const Trajectory& truth,
                                     double from_s, double to_s);

/// Two policies at the same places: the exact two-sided test of McNemar.
struct Paired {
  std::size_t both = 0;
  std::size_t only_first = 0;
  std::size_t only_second = 0;
  std::size_t neither = 0;

  double p_value() const;
};

/// By place: whether it was survived.
using Survived = std::map<std::string, bool>;

Share share_of(const Survived& survived);
/// Of the places that both have.
Paired compare_places(const Survived& first, const Survived& second);

}  // namespace orbbuf::evaluation
