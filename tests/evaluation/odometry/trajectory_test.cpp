// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/trajectory.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace orbbuf::evaluation {
namespace {

constexpr double kFps = 25;

Trajectory circle(double scale, double turn) {
  Trajectory trajectory;
  const Eigen::AngleAxisd whole(turn, Eigen::Vector3d(1, 2, 3).normalized());
  for (int i = 0; i < 100; ++i) {
    StampedPose& stamped = trajectory.emplace_back();
    stamped.time_s = i / kFps;
    const double angle = i * 0.05;
    stamped.pose.translation() =
        whole *
        Eigen::Vector3d(scale * std::cos(angle), scale * std::sin(angle), 0.1 * scale * angle);
    stamped.pose.linear() =
        (whole * Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ())).toRotationMatrix();
  }
  return trajectory;
}

TEST(Trajectory, AlignedCopiesDoNotDiffer) {
  const TrajectoryError error = compare(circle(0.25, 1), circle(1, 0), true);
  EXPECT_EQ(error.poses, 100U);
  EXPECT_NEAR(error.scale, 4, 1e-9);
  EXPECT_LT(error.ate_m, 1e-9);
  EXPECT_LT(error.rpe_m, 1e-9);
}

TEST(Trajectory, WrongScaleIsAnErrorWhereItIsKnown) {
  const TrajectoryError error = compare(circle(0.9, 1), circle(1, 0), false);
  EXPECT_NEAR(error.scale, 1, 1e-9);
  EXPECT_GT(error.ate_m, 0.01);
}

TEST(Trajectory, AteIsWhatOnePoseIsOff) {
  Trajectory off = circle(1, 0);
  off[50].pose.translation().z() += 1;
  const double ate = compare(off, circle(1, 0), false).ate_m;
  EXPECT_NEAR(ate, 0.1, 0.01);  // the root of 1/100, but for what alignment takes
}

}  // namespace
}  // namespace orbbuf::evaluation
