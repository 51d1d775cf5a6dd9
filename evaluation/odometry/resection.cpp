// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/resection.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <numbers>
#include <opencv2/calib3d.hpp>

namespace orbbuf::evaluation {
namespace {

constexpr int kIterations = 150;
constexpr float kAgreePx = 2.5F;
constexpr double kMissPx = 2;
constexpr double kNearest = 1e-3;

Eigen::Isometry3d to_pose(const cv::Vec3d& turn, const cv::Vec3d& place) {
  cv::Matx33d rotation;
  cv::Rodrigues(turn, rotation);
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      pose.linear()(row, column) = rotation(row, column);
    }
    pose.translation()(row) = place[row];
  }
  return pose;
}

/// The ray through a pixel, in the world.
Eigen::Vector3d ray_of(const Camera& camera, const Eigen::Isometry3d& pose,
                       const Eigen::Vector2d& pixel) {
  const Eigen::Vector3d ray((pixel.x() - camera.cx) / camera.fx,
                            (pixel.y() - camera.cy) / camera.fy, 1);
  return (pose.linear().transpose() * ray).normalized();
}

bool is_seen_at(const Camera& camera, const Eigen::Isometry3d& pose, const Eigen::Vector3d& point,
                const Eigen::Vector2d& pixel) {
  const auto seen = project(camera, pose, point);
  return seen && (*seen - pixel).norm() < kMissPx;
}

}  // namespace

cv::Matx33d matrix_of(const Camera& camera) {
  return {camera.fx, 0, camera.cx, 0, camera.fy, camera.cy, 0, 0, 1};
}

std::optional<Eigen::Vector2d> project(const Camera& camera, const Eigen::Isometry3d& pose,
                                       const Eigen::Vector3d& point) {
  const Eigen::Vector3d p = pose * point;
  if (p.z() < kNearest) return std::nullopt;
  return Eigen::Vector2d(camera.fx * p.x() / p.z() + camera.cx,
                         camera.fy * p.y() / p.z() + camera.cy);
}

std::optional<Resection> resect(const Camera& camera, const std::vector<cv::Point3d>& points,
                                const std::vector<cv::Point2d>& pixels) {
  if (points.size() < 4) return std::nullopt;
  const cv::Matx33d matrix = matrix_of(camera);
  cv::Vec3d turn;
  cv::Vec3d place;
  Resection result;
  try {
    if (!cv::solvePnPRansac(points, pixels, matrix, cv::noArray(), turn, place, false, kIterations,
                            kAgreePx, 0.995, result.inliers, cv::SOLVEPNP_AP3P) ||
        result.inliers.size() < 4) {
      return std::nullopt;
    }
  } catch (const cv::Exception&) {
    return std::nullopt;  // OpenCV's way to say that the points are degenerate
  }
  std::vector<cv::Point3d> good_points;
  std::vector<cv::Point2d> good_pixels;
  for (const int i : result.inliers) {
    good_points.push_back(points[static_cast<std::size_t>(i)]);
    good_pixels.push_back(pixels[static_cast<std::size_t>(i)]);
  }
  cv::solvePnPRefineLM(good_points, good_pixels, matrix, cv::noArray(), turn, place);
  result.pose = to_pose(turn, place);
  if (!result.pose.matrix().allFinite()) return std::nullopt;
  return result;
}

std::optional<Eigen::Vector3d> triangulate(const Camera& camera, const Eigen::Isometry3d& pose_a,
                                           const Eigen::Vector2d& pixel_a,
                                           const Eigen::Isometry3d& pose_b,
                                           const Eigen::Vector2d& pixel_b, double least_degrees) {
  const Eigen::Vector3d ray_a = ray_of(camera, pose_a, pixel_a);
  const Eigen::Vector3d ray_b = ray_of(camera, pose_b, pixel_b);
  const double cosine = ray_a.dot(ray_b);
  if (cosine > std::cos(least_degrees * std::numbers::pi / 180)) return std::nullopt;
  const Eigen::Vector3d from_a = pose_a.inverse().translation();
  const Eigen::Vector3d from_b = pose_b.inverse().translation();
  // Where the rays are nearest each other; halfway between.
  const Eigen::Vector3d apart = from_b - from_a;
  const double span = 1 - cosine * cosine;
  const double along_a = (apart.dot(ray_a) - cosine * apart.dot(ray_b)) / span;
  const double along_b = (cosine * apart.dot(ray_a) - apart.dot(ray_b)) / span;
  const Eigen::Vector3d point = 0.5 * (from_a + along_a * ray_a + from_b + along_b * ray_b);
  if (!is_seen_at(camera, pose_a, point, pixel_a) || !is_seen_at(camera, pose_b, point, pixel_b)) {
    return std::nullopt;
  }
  return point;
}

}  // namespace orbbuf::evaluation
