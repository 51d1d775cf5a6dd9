// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "evaluation/camera.hpp"
#include "evaluation/odometry/flow.hpp"
#include "evaluation/odometry/map.hpp"
#include "evaluation/odometry/motion.hpp"

namespace orbbuf::evaluation {

/// One frame as the odometry gets it: 8-bit gray, rectified.
struct GrayFrame {
  double time_s = 0;
  cv::Mat left;
  cv::Mat right;  ///< empty: mono
};

/// Visual odometry as plain as it can be and still stand for a SLAM program: corners are followed
/// (KLT) from where its motion lets them be expected, poses come from PnP with RANSAC, keyframes
/// get new points from the right image or, of one camera, by triangulation, and the newest ones are
/// adjusted together. Where following fails, as it does over a gap, the points are looked for by
/// their descriptors; where that fails for kPatience frames in a row, it is lost, and remains so:
/// it closes no loops and starts no second map.
///
/// One camera gives poses in a scale of its own. Deterministic. A copy goes on by itself: take one
/// where two futures part.
class Odometry {
 public:
  enum class State { kStarting, kTracking, kLost };
  static constexpr int kPatience = 5;

  explicit Odometry(const Camera& camera) : camera_(camera) {}

  /// The camera's place and axes in the world, which are those of the first frame; nothing while it
  /// is starting, and for frames that it could not place.
  std::optional<Eigen::Isometry3d> track(const GrayFrame& frame);

  State state() const { return state_; }

 private:
  void begin(const GrayFrame& frame, Pyramid pyramid);
  void start_mono(const GrayFrame& frame, Pyramid pyramid);
  bool make_first_map();
  void keep(const std::vector<Flow>& flows);
  bool locate(const Pyramid& pyramid, const Eigen::Isometry3d& expected);
  bool locate_anywhere(const GrayFrame& frame);
  bool take_pose(std::size_t least_inliers, double least_share);
  void forget_outliers();
  void add_points_by_motion();
  bool wants_keyframe() const;
  void add_keyframe(const GrayFrame& frame);
  void add_points_by_stereo(const GrayFrame& frame);
  void add_corners(const cv::Mat& image);
  std::size_t points() const;

  Camera camera_;
  State state_ = State::kStarting;
  Pyramid last_;  ///< of the last frame that has a pose
  cv::Mat last_image_;
  Eigen::Isometry3d pose_ = Eigen::Isometry3d::Identity();  ///< world to camera
  Motion motion_;
  Keyframes keyframes_;
  std::vector<Track> tracks_;
  std::size_t points_at_keyframe_ = 0;
  int failures_ = 0;
};

}  // namespace orbbuf::evaluation
