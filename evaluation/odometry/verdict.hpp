// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/odometry/frames.hpp"
#include "evaluation/odometry/odometry.hpp"
#include "evaluation/odometry/trajectory.hpp"

namespace orbbuf::evaluation {

/// What came of a run of the odometry over frames.
struct Verdict {
  std::size_t frames = 0;
  std::size_t starting = 0;              ///< before there was a first map: nobody's fault
  std::size_t unplaced = 0;              ///< after it
  std::optional<std::uint64_t> lost_at;  ///< the first of the frames that it never came back from
  Trajectory trajectory;

  bool is_lost() const { return lost_at.has_value(); }
  double tracked_share() const;
};

/// An odometry and its verdict so far. A copy goes on by itself.
class Judge {
 public:
  explicit Judge(const Camera& camera) : odometry_(camera) {}

  /// id: named should it be lost there.
  void see(const JudgedFrame& frame, std::uint64_t id);

  const Verdict& verdict() const { return verdict_; }

 private:
  Odometry odometry_;
  Verdict verdict_;
  std::uint64_t failing_since_ = 0;
  bool is_failing_ = false;
};

/// Whether the trajectory has a pose in the last second before `end_s`.
bool reaches(const Trajectory& trajectory, double end_s);

/// What came of any other SLAM program's run over these frames, by the poses it has written, in
/// order, of all frames or of keyframes only: a frame between two that are up to 1 s apart is
/// tracked; lost behind the last of them unless it reaches() the last frame.
Verdict verdict_of(Trajectory trajectory, const std::vector<ListedFrame>& frames);

/// One line, for people.
std::string to_text(const Verdict& verdict, const TrajectoryError& error);

}  // namespace orbbuf::evaluation
