// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <vector>

#include "evaluation/camera.hpp"
#include "evaluation/odometry/map.hpp"

namespace orbbuf::evaluation {

/// How the camera moves, to say where it will be: as fast as between the last two frames that have
/// a pose, for at most a second.
class Motion {
 public:
  /// pose: world to camera.
  void moved_to(double time_s, const Eigen::Isometry3d& pose);

  /// World to camera.
  Eigen::Isometry3d expected(double time_s) const;

 private:
  double time_s_ = 0;
  Eigen::Isometry3d pose_ = Eigen::Isometry3d::Identity();
  Eigen::Vector3d turning_ = Eigen::Vector3d::Zero();  ///< radians a second, in the camera's axes
  Eigen::Vector3d going_ = Eigen::Vector3d::Zero();    ///< a second, in the world
  bool has_pose_ = false;
};

/// Where the tracks are expected once the camera has come from `last` to `now` (world to camera):
/// points by both, what has no point yet as if it was far away.
std::vector<cv::Point2f> expected_pixels(const Camera& camera, const std::vector<Track>& tracks,
                                         const Eigen::Isometry3d& last,
                                         const Eigen::Isometry3d& now);

}  // namespace orbbuf::evaluation
