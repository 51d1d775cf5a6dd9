// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/time_shift.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace orbbuf {
namespace {

constexpr double kPixelsPerRadian = 150;

/// Turned to and fro by hand, at time_s.
double angle(double time_s) { return 0.3 * std::sin(5 * time_s) + 0.1 * std::sin(11 * time_s); }

/// 6 s at 25 frames/s, whose times are `late_s` behind.
std::vector<ImageMotion> seen(double late_s, double noise_px = 0) {
  std::mt19937 random;
  std::normal_distribution<double> noise(0, 1);
  std::vector<ImageMotion> motions;
  for (int i = 10; i < 150; ++i) {
    const double from_s = 0.04 * i;
    const double moved = kPixelsPerRadian * std::abs(angle(from_s + 0.04) - angle(from_s));
    const auto ns = [late_s](double time_s) { return std::llround((time_s + late_s) * 1e9); };
    motions.push_back({ns(from_s), ns(from_s + 0.04), moved + noise_px * noise(random)});
  }
  return motions;
}

/// 200 Hz.
std::vector<Sample> felt() {
  std::vector<Sample> samples;
  for (int i = -200; i < 1500; ++i) {
    const double time_s = 0.005 * i;
    Sample sample;
    sample.time_ns = std::llround(time_s * 1e9);
    sample.angular_velocity = {0, (angle(time_s + 1e-4) - angle(time_s - 1e-4)) / 2e-4, 0};
    samples.push_back(sample);
  }
  return samples;
}

TEST(TimeShiftTest, IsThatOfTheClocks) {
  for (const double late_s : {-0.13, 0.0, 0.008, 0.05}) {
    const auto shift = find_time_shift(seen(late_s), felt());
    ASSERT_TRUE(shift);
    EXPECT_NEAR(shift->seconds, -late_s, 0.0011);
    EXPECT_GT(shift->correlation, 0.99);
  }
}

TEST(TimeShiftTest, IsFoundThroughNoise) {
  const auto shift = find_time_shift(seen(0.03, 1.0), felt());
  ASSERT_TRUE(shift);
  EXPECT_NEAR(shift->seconds, -0.03, 0.01);
  EXPECT_LT(shift->correlation, 0.99);
}

TEST(TimeShiftTest, ThereIsNoneWithoutMotion) {
  auto still = seen(0);
  for (ImageMotion& motion : still) motion.pixels = 1;
  EXPECT_FALSE(find_time_shift(still, felt()));
  auto resting = felt();
  for (Sample& sample : resting) sample.angular_velocity = {};
  EXPECT_FALSE(find_time_shift(seen(0), resting));
}

TEST(TimeShiftTest, ThereIsNoneOfTooLittle) {
  EXPECT_FALSE(find_time_shift({}, felt()));
  EXPECT_FALSE(find_time_shift(seen(0), {}));
  const auto motions = seen(0);
  const auto samples = felt();
  EXPECT_FALSE(find_time_shift(std::span(motions).first(19), samples));
  EXPECT_FALSE(find_time_shift(motions, std::span(samples).first(300)));
}

}  // namespace
}  // namespace orbbuf
