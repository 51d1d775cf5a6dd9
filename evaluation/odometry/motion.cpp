// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/motion.hpp"

#include <algorithm>

#include "evaluation/odometry/resection.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr double kLongestS = 1;

Eigen::Vector3d place_of(const Eigen::Isometry3d& pose) {
  return -(pose.linear().transpose() * pose.translation());
}

}  // namespace

void Motion::moved_to(double time_s, const Eigen::Isometry3d& pose) {
  const double passed_s = time_s - time_s_;
  if (has_pose_ && passed_s > 0) {
    const Eigen::AngleAxisd turned(Eigen::Matrix3d(pose.linear() * pose_.linear().transpose()));
    turning_ = turned.axis() * turned.angle() / passed_s;
    going_ = (place_of(pose) - place_of(pose_)) / passed_s;
  }
  time_s_ = time_s;
  pose_ = pose;
  has_pose_ = true;
}

Eigen::Isometry3d Motion::expected(double time_s) const {
  const double passed_s = std::clamp(time_s - time_s_, 0.0, kLongestS);
  const Eigen::Vector3d turn = turning_ * passed_s;
  Eigen::Isometry3d pose = pose_;
  if (turn.norm() > 1e-9) {
    pose.linear() = Eigen::AngleAxisd(turn.norm(), turn.normalized()) * pose_.linear();
  }
  pose.translation() = -(pose.linear() * (place_of(pose_) + going_ * passed_s));
  return pose;
}

std::vector<cv::Point2f> expected_pixels(const Camera& camera, const std::vector<Track>& tracks,
                                         const Eigen::Isometry3d& last,
                                         const Eigen::Isometry3d& now) {
  Eigen::Isometry3d turn = Eigen::Isometry3d::Identity();
  turn.linear() = now.linear() * last.linear().transpose();
  std::vector<cv::Point2f> pixels;
  pixels.reserve(tracks.size());
  for (const Track& track : tracks) {
    const Eigen::Vector3d ray((track.pixel.x - camera.cx) / camera.fx,
                              (track.pixel.y - camera.cy) / camera.fy, 1);
    const auto pixel =
        track.has_point ? project(camera, now, track.point) : project(camera, turn, ray);
    pixels.push_back(
        pixel ? cv::Point2f(static_cast<float>(pixel->x()), static_cast<float>(pixel->y()))
              : track.pixel);
  }
  return pixels;
}

}  // namespace orbbuf::evaluation
