// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "evaluation/camera.hpp"

namespace orbbuf::evaluation {

cv::Matx33d matrix_of(const Camera& camera);

/// A point's pixel; nothing if it is behind the camera. `pose` takes the world to the camera.
std::optional<Eigen::Vector2d> project(const Camera& camera, const Eigen::Isometry3d& pose,
                                       const Eigen::Vector3d& point);

struct Resection {
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();  ///< world to camera
  std::vector<int> inliers;
};

/// The camera's pose from points and their pixels: PnP with RANSAC (2.5 px), refined on all that
/// agree. Nothing with fewer than four points or no agreement. The same for the same input.
std::optional<Resection> resect(const Camera& camera, const std::vector<cv::Point3d>& points,
                                const std::vector<cv::Point2d>& pixels);

/// The point that two cameras see at these pixels; nothing if the rays meet at less than
/// `least_degrees`, or miss each other by more than 2 px, or behind a camera.
std::optional<Eigen::Vector3d> triangulate(const Camera& camera, const Eigen::Isometry3d& pose_a,
                                           const Eigen::Vector2d& pixel_a,
                                           const Eigen::Isometry3d& pose_b,
                                           const Eigen::Vector2d& pixel_b, double least_degrees);

}  // namespace orbbuf::evaluation
