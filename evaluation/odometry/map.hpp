// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <opencv2/core.hpp>
#include <vector>

namespace orbbuf::evaluation {

/// Where a keyframe has seen a point.
struct Observation {
  std::size_t keyframe = 0;
  Eigen::Vector2d pixel;
  double right_x = -1;  ///< in the right image; negative: not seen there
};

/// Something that is followed from frame to frame, and once it is known where it is, a point of the
/// map.
struct Track {
  cv::Point2f pixel;  ///< in the last frame
  bool has_point = false;
  Eigen::Vector3d point = Eigen::Vector3d::Zero();  ///< in the world
  std::vector<Observation> seen;                    ///< by keyframes, in order; never empty
};

/// Poses take the world to the camera.
using Keyframes = std::vector<Eigen::Isometry3d>;

}  // namespace orbbuf::evaluation
