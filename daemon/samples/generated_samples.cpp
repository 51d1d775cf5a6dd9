// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/generated_samples.hpp"

#include <array>
#include <cmath>

#include "daemon/capture/replay/scene_pose.hpp"

namespace orbbuf {
namespace {

constexpr double kGravity = 9.81;  // m/s^2
// Of one sample at 200 Hz: the density of the data sheet times the root of half the rate; and bias.
constexpr double kGyroNoise = 8.7e-5 * 10;
constexpr double kAccelNoise = 3.9e-3 * 10;
constexpr std::array<double, 3> kGyroBias{0.004, -0.003, 0.002};
constexpr std::array<double, 3> kAccelBias{0.04, -0.05, 0.03};

/// Of `value` at time_s: how fast its change changes.
template <class Value>
double second_derivative(const Value& value, double time_s) {
  constexpr double kStepS = 1e-2;
  return (value(time_s + kStepS) - 2 * value(time_s) + value(time_s - kStepS)) / (kStepS * kStepS);
}

}  // namespace

Sample GeneratedSamples::sample_at(std::int64_t since_begin_ns) {
  constexpr double kStepS = 1e-4;
  const double time_s = static_cast<double>(since_begin_ns) * 1e-9;
  const auto acceleration = [time_s](double ScenePose::*axis) {
    return second_derivative([axis](double t) { return scene_pose_at(t).*axis; }, time_s);
  };
  const double roll = scene_pose_at(time_s).roll_rad;
  const double x = acceleration(&ScenePose::x);
  const double y = acceleration(&ScenePose::y);
  Sample sample;
  sample.time_ns = *begin_ns_ + since_begin_ns;
  sample.angular_velocity[2] =
      (scene_pose_at(time_s + kStepS).roll_rad - scene_pose_at(time_s - kStepS).roll_rad) /
      (2 * kStepS);
  // The camera's axes are turned by roll against the floor's, and farther away is up.
  sample.linear_acceleration = {std::cos(roll) * x + std::sin(roll) * y,
                                std::cos(roll) * y - std::sin(roll) * x,
                                -acceleration(&ScenePose::zoom) - kGravity};
  std::normal_distribution<double> noise;
  for (std::size_t i = 0; i < kGyroBias.size(); ++i) {
    sample.angular_velocity.at(i) += kGyroBias.at(i) + kGyroNoise * noise(random_);
    sample.linear_acceleration.at(i) += kAccelBias.at(i) + kAccelNoise * noise(random_);
  }
  return sample;
}

void GeneratedSamples::on_frame(std::int64_t time_ns) {
  if (!begin_ns_) {
    begin_ns_ = time_ns;
    begin_ = std::chrono::steady_clock::now();
    wait_for_next();
  }
  take_until(time_ns - *begin_ns_);
}

void GeneratedSamples::take_until(std::int64_t since_begin_ns) {
  for (; next_ns_ <= since_begin_ns; next_ns_ += kStepNs) take_(sample_at(next_ns_));
}

void GeneratedSamples::wait_for_next() {
  timer_.expires_at(begin_ + std::chrono::nanoseconds(next_ns_));
  timer_.async_wait([this, life = life()](const boost::system::error_code& error) {
    if (error || life.expired()) return;
    const std::chrono::nanoseconds since_begin = std::chrono::steady_clock::now() - begin_;
    take_until(since_begin.count());
    wait_for_next();
  });
}

}  // namespace orbbuf
