// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <filesystem>
#include <vector>

namespace orbbuf::evaluation {

/// Where the left camera was: its axes (x right, y down, z ahead) and place in the world.
struct StampedPose {
  double time_s = 0;
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
};

using Trajectory = std::vector<StampedPose>;

/// TUM's form: time, place, quaternion x y z w; lines with a '#' do not count. Throws
/// std::runtime_error naming file and line.
Trajectory read_trajectory(const std::filesystem::path& file);
void write_trajectory(const std::filesystem::path& file, const Trajectory& trajectory);

/// The first pose of that moment (within 1 ms); null: there is none. By time, as read.
const StampedPose* pose_at(const Trajectory& trajectory, double time_s);

/// How far an estimate is from the truth.
struct TrajectoryError {
  std::size_t poses = 0;  ///< that have a true one of the same time (within 1 ms)
  double ate_m = 0;       ///< root mean square of the places' distances, once aligned
  double rpe_m = 0;       ///< the same of the motion over a second
  double rpe_deg = 0;     ///< and of its rotation
  double path_m = 0;      ///< length of the true path under these poses
  double scale = 1;       ///< that the estimate was multiplied with
};

/// Aligned by Umeyama's method; with_scale: for estimates of one camera, which cannot know it. With
/// fewer than three poses all is 0 but their number.
TrajectoryError compare(const Trajectory& estimate, const Trajectory& truth, bool with_scale);

}  // namespace orbbuf::evaluation
