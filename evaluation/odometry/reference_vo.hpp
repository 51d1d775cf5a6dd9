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

/// What an odometry made of a sequence of frames.
struct TrackingResult {
  std::size_t frames = 0;
  std::size_t starting = 0;              ///< before there was a first map; not counted as failures
  std::size_t unplaced = 0;              ///< after it
  std::optional<std::uint64_t> lost_at;  ///< the first of the frames that it never came back from
  Trajectory trajectory;

  bool is_lost() const { return lost_at.has_value(); }
  double tracked_share() const;
};

/// The reference VO: an odometry, and its result so far. A copy goes on by itself.
class ReferenceVo {
 public:
  explicit ReferenceVo(const Camera& camera) : odometry_(camera) {}

  /// id: of the frame, for lost_at.
  void track(const GrayFrame& frame, std::uint64_t id);

  const TrackingResult& result() const { return result_; }

 private:
  Odometry odometry_;
  TrackingResult result_;
  std::uint64_t failing_since_ = 0;
  bool is_failing_ = false;
};

/// Whether the trajectory has a pose in the last second before `end_s`.
bool reaches(const Trajectory& trajectory, double end_s);

/// The result of any other SLAM program on these frames, from the poses that it has written, in
/// order, of all frames or of keyframes only. A frame between two that are up to 1 s apart is
/// tracked. The program is lost after the last pose unless that reaches() the last frame.
TrackingResult result_of(Trajectory trajectory, const std::vector<ListedFrame>& frames);

/// One line, for people.
std::string to_text(const TrackingResult& result, const TrajectoryError& error);

}  // namespace orbbuf::evaluation
