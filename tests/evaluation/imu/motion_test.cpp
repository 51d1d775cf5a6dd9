// SPDX-License-Identifier: Apache-2.0
#include "evaluation/imu/motion.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <stdexcept>

namespace orbbuf::evaluation {
namespace {

using Eigen::Vector3d;

const Vector3d kUp(0, 0, 1);
constexpr double kGravity = 9.81;
constexpr double kTurning = 0.8;  // rad/s
constexpr double kRadius = 2;

Vector3d vector_of(const std::array<double, 3>& values) {
  return Eigen::Map<const Vector3d>(values.data());
}

/// A body that drives along a circle, x ahead and z up, and so turns more than once.
StampedPose on_circle(double time_s) {
  const double angle = kTurning * time_s;
  StampedPose pose;
  pose.time_s = time_s;
  pose.pose.linear() = Eigen::AngleAxisd(angle + M_PI / 2, Vector3d::UnitZ()).toRotationMatrix();
  pose.pose.translation() = kRadius * Vector3d(std::cos(angle), std::sin(angle), 0);
  return pose;
}

Motion circle() {
  Trajectory poses;
  for (int i = 0; i <= 250; ++i) poses.push_back(on_circle(1 + i / 25.0));
  return Motion(poses);
}

TEST(Motion, ACircleHasItsTurningAndItsPullToTheMiddle) {
  const Motion motion = circle();
  for (const double time_s : {2.0, 4.321, 9.99}) {  // the ends are bent: a natural spline
    const Sample sample = motion.at(time_s, kUp);
    EXPECT_EQ(sample.time_ns, std::llround(time_s * 1e9));
    EXPECT_LT((vector_of(sample.angular_velocity) - Vector3d(0, 0, kTurning)).norm(), 1e-4);
    const Vector3d pull(0, kRadius * kTurning * kTurning, kGravity);
    EXPECT_LT((vector_of(sample.linear_acceleration) - pull).norm(), 1e-3);
  }
}

TEST(Motion, TheSumOfTheSamplesIsTheMotion) {
  const auto samples = imu_samples(circle(), 200, kUp, imu_grades().front(), 1);
  const StampedPose begin = on_circle(2);
  Eigen::Quaterniond turn(begin.pose.rotation());
  Vector3d place = begin.pose.translation();
  Vector3d speed =
      kRadius * kTurning * Vector3d(-std::sin(2 * kTurning), std::cos(2 * kTurning), 0);
  constexpr double kStepS = 1.0 / 200;
  for (std::size_t i = 200; i < 200 + 8 * 200; ++i) {
    const auto middle = [&](auto Sample::*values) {
      return Vector3d(0.5 * (vector_of(samples[i].*values) + vector_of(samples[i + 1].*values)));
    };
    const Vector3d angle = kStepS * middle(&Sample::angular_velocity);
    const Eigen::Quaterniond half(Eigen::AngleAxisd(angle.norm() / 2, angle.normalized()));
    const Vector3d pull = turn * half * middle(&Sample::linear_acceleration) - kGravity * kUp;
    place += kStepS * speed + kStepS * kStepS / 2 * pull;
    speed += kStepS * pull;
    turn = turn * half * half;
  }
  const StampedPose end = on_circle(10);
  EXPECT_LT((place - end.pose.translation()).norm(), 1e-3);
  EXPECT_LT(turn.angularDistance(Eigen::Quaterniond(end.pose.rotation())), 1e-5);
}

TEST(Motion, ABodyAtRestFeelsGravityAlone) {
  Trajectory poses(3);
  for (int i = 0; i < 3; ++i) poses[static_cast<std::size_t>(i)].time_s = i;
  const Sample sample = Motion(poses).at(0.7, Vector3d(0, -1, 0));
  EXPECT_EQ(vector_of(sample.angular_velocity), Vector3d(0, 0, 0));
  EXPECT_EQ(vector_of(sample.linear_acceleration), Vector3d(0, -kGravity, 0));
}

TEST(Motion, NoiseHasTheDensityOfItsGradeAndComesFromTheSeed) {
  Trajectory poses(2);
  poses[1].time_s = 100;
  const Motion rest(poses);
  const ImuGrade grade{"test", 1e-3, 0, 1e-2, 0, 0, 0};
  const auto samples = imu_samples(rest, 400, kUp, grade, 7);
  ASSERT_EQ(samples.size(), 40'002U);  // one is behind the end
  double gyro = 0;
  double accel = 0;
  for (const Sample& sample : samples) {
    gyro += vector_of(sample.angular_velocity).squaredNorm() / 3;
    accel += (vector_of(sample.linear_acceleration) - kGravity * kUp).squaredNorm() / 3;
  }
  const auto n = static_cast<double>(samples.size());
  EXPECT_NEAR(std::sqrt(gyro / n), 1e-3 * 20, 1e-3 * 20 * 0.02);
  EXPECT_NEAR(std::sqrt(accel / n), 1e-2 * 20, 1e-2 * 20 * 0.02);
  EXPECT_EQ(imu_samples(rest, 400, kUp, grade, 7), samples);
  EXPECT_NE(imu_samples(rest, 400, kUp, grade, 8), samples);
}

TEST(Motion, ABiasStaysOrWalks) {
  Trajectory poses(2);
  poses[1].time_s = 10;
  const Motion rest(poses);
  const auto stays = imu_samples(rest, 100, kUp, {"test", 0, 0, 0, 0, 0.1, 0}, 1);
  EXPECT_NE(stays.front().angular_velocity[0], 0);
  EXPECT_EQ(stays.front().angular_velocity, stays.back().angular_velocity);
  const auto walks = imu_samples(rest, 100, kUp, {"test", 0, 0.1, 0, 0, 0, 0}, 1);
  EXPECT_EQ(walks.front().angular_velocity[0], 0);
  EXPECT_NE(walks.back().angular_velocity[0], 0);
}

TEST(Motion, NeedsPosesInOrder) {
  EXPECT_THROW(Motion(Trajectory(1)), std::runtime_error);
  EXPECT_THROW(Motion(Trajectory(2)), std::runtime_error);
}

}  // namespace
}  // namespace orbbuf::evaluation
