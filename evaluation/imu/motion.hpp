// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "common/sample.hpp"
#include "evaluation/odometry/trajectory.hpp"

namespace orbbuf::evaluation {

/// The smooth motion through the poses of a trajectory: natural cubic splines of the position and
/// of the four numbers of the rotation. Velocity and acceleration are continuous.
class Motion {
 public:
  /// At least two poses, in order of time. Throws std::runtime_error.
  explicit Motion(const Trajectory& poses);

  /// What a sensor without errors reads that has the axes and the place of the camera. up: the
  /// world's, of length 1.
  Sample at(double time_s, const Eigen::Vector3d& up) const;

  double begin_s() const { return times_s_.front(); }
  double end_s() const { return times_s_.back(); }

 private:
  static constexpr int kNumbers = 7;  ///< position x y z, rotation x y z w
  using Numbers = Eigen::Array<double, kNumbers, 1>;

  std::vector<double> times_s_;
  std::vector<Numbers> values_;
  std::vector<Numbers> bends_;  ///< second derivatives
};

/// What makes a real sensor's samples differ from the truth: the constants of Kalibr's imu.yaml,
/// and the bias with which the recording starts.
struct ImuGrade {
  std::string name;
  double gyro_noise = 0;   ///< rad/s/sqrt(Hz)
  double gyro_walk = 0;    ///< of the bias, rad/s^2/sqrt(Hz)
  double accel_noise = 0;  ///< m/s^2/sqrt(Hz)
  double accel_walk = 0;   ///< m/s^3/sqrt(Hz)
  double gyro_bias = 0;    ///< at the start, rad/s, standard deviation of each axis
  double accel_bias = 0;   ///< m/s^2
};

/// README.md names the sources.
const std::vector<ImuGrade>& imu_grades();

/// From the motion's begin to the first sample behind its end. The same seed gives the same
/// samples.
std::vector<Sample> imu_samples(const Motion& motion, double rate_hz, const Eigen::Vector3d& up,
                                const ImuGrade& grade, std::uint64_t seed);

}  // namespace orbbuf::evaluation
