// SPDX-License-Identifier: Apache-2.0
#include "evaluation/imu/motion.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>

#include "evaluation/random.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr double kGravity = 9.81;

/// Of the standard normal distribution, in three axes.
Eigen::Array3d noise(std::mt19937_64& random) {
  Eigen::Array3d values;
  for (double& value : values) {
    const double length = std::sqrt(-2 * std::log(uniform(random, 0x1p-53, 1)));
    value = length * std::cos(uniform(random, 0, 2 * std::numbers::pi));
  }
  return values;
}

void add(std::array<double, 3>& values, const Eigen::Array3d& error) {
  Eigen::Map<Eigen::Array3d>(values.data()) += error;
}

}  // namespace

Motion::Motion(const Trajectory& poses) {
  if (poses.size() < 2) throw std::runtime_error("a motion needs at least two poses");
  for (const StampedPose& pose : poses) {
    Eigen::Quaterniond turn(pose.pose.rotation());
    // q and -q are the same rotation; the nearer one to the last.
    if (!values_.empty() && (values_.back().tail<4>() * turn.coeffs().array()).sum() < 0) {
      turn.coeffs() *= -1;
    }
    if (!times_s_.empty() && pose.time_s <= times_s_.back()) {
      throw std::runtime_error("the poses are not in the order of time");
    }
    times_s_.push_back(pose.time_s);
    values_.emplace_back() << pose.pose.translation().array(), turn.coeffs().array();
  }
  // The tridiagonal equations of the natural spline; Thomas's algorithm.
  const std::size_t n = times_s_.size();
  bends_.assign(n, Numbers::Zero());
  std::vector<double> upper(n, 0);
  for (std::size_t i = 1; i + 1 < n; ++i) {
    const double before = times_s_[i] - times_s_[i - 1];
    const double after = times_s_[i + 1] - times_s_[i];
    const double pivot = 2 * (before + after) - before * upper[i - 1];
    upper[i] = after / pivot;
    const Numbers turn =
        (values_[i + 1] - values_[i]) / after - (values_[i] - values_[i - 1]) / before;
    bends_[i] = (6 * turn - before * bends_[i - 1]) / pivot;
  }
  for (std::size_t i = n - 1; i-- > 0;) bends_[i] -= upper[i] * bends_[i + 1];
}

Sample Motion::at(double time_s, const Eigen::Vector3d& up) const {
  const auto after = std::ranges::upper_bound(times_s_, time_s) - times_s_.begin();
  const auto i =
      static_cast<std::size_t>(std::clamp<std::ptrdiff_t>(after - 1, 0, std::ssize(times_s_) - 2));
  const double step = times_s_[i + 1] - times_s_[i];
  const double b = (time_s - times_s_[i]) / step;
  const double a = 1 - b;
  const Numbers value =
      a * values_[i] + b * values_[i + 1] +
      ((a * a * a - a) * bends_[i] + (b * b * b - b) * bends_[i + 1]) * (step * step / 6);
  const Numbers speed =
      (values_[i + 1] - values_[i]) / step +
      ((1 - 3 * a * a) * bends_[i] + (3 * b * b - 1) * bends_[i + 1]) * (step / 6);
  const Numbers bend = a * bends_[i] + b * bends_[i + 1];
  const Eigen::Quaterniond turn(Eigen::Vector4d(value.tail<4>()));
  const Eigen::Quaterniond turning(Eigen::Vector4d(speed.tail<4>()));
  Sample sample;
  sample.time_ns = std::llround(time_s * 1e9);
  // Also of a quaternion that is not quite of length 1: the length's change is in the real part.
  add(sample.angular_velocity, 2 * (turn.inverse() * turning).vec().array());
  add(sample.linear_acceleration,
      (turn.normalized().inverse() * (bend.head<3>().matrix() + kGravity * up)).array());
  return sample;
}

const std::vector<ImuGrade>& imu_grades() {
  static const std::vector<ImuGrade> grades = {
      {"none", 0, 0, 0, 0, 0, 0},
      {"adis16448", 1.6968e-4, 1.9393e-5, 2.0e-3, 3.0e-3, 0.005, 0.05},
      {"mpu6050", 8.7e-5, 1.0e-6, 3.9e-3, 1.2e-5, 0.005, 0.05}};
  return grades;
}

std::vector<Sample> imu_samples(const Motion& motion, double rate_hz, const Eigen::Vector3d& up,
                                const ImuGrade& grade, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  Eigen::Array3d gyro_bias = grade.gyro_bias * noise(random);
  Eigen::Array3d accel_bias = grade.accel_bias * noise(random);
  const auto count = static_cast<std::size_t>((motion.end_s() - motion.begin_s()) * rate_hz) + 2;
  const double root = std::sqrt(rate_hz);
  std::vector<Sample> samples;
  samples.reserve(count);
  while (samples.size() < count) {
    const double time_s = motion.begin_s() + static_cast<double>(samples.size()) / rate_hz;
    Sample& sample = samples.emplace_back(motion.at(time_s, up));
    add(sample.angular_velocity, gyro_bias + grade.gyro_noise * root * noise(random));
    add(sample.linear_acceleration, accel_bias + grade.accel_noise * root * noise(random));
    gyro_bias += grade.gyro_walk / root * noise(random);
    accel_bias += grade.accel_walk / root * noise(random);
  }
  return samples;
}

}  // namespace orbbuf::evaluation
