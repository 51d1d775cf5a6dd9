// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/generated_samples.hpp"

#include <gtest/gtest.h>

#include <array>
#include <boost/asio/post.hpp>
#include <chrono>
#include <cmath>
#include <optional>
#include <vector>

#include "daemon/capture/replay/scene_pose.hpp"

namespace orbbuf {
namespace {

class GeneratedSamplesTest : public ::testing::Test {
 protected:
  static constexpr std::int64_t kBeginNs = 1'700'000'000'000'000'000;

  GeneratedSamplesTest() {
    GeneratedSamples source(main_, [this](const Sample& sample) { samples_.push_back(sample); });
    source.on_frame(kBeginNs);
    EXPECT_EQ(samples_.size(), 1U);
    source.on_frame(kBeginNs + 12'000'000'000);
  }

  boost::asio::io_context main_;
  std::vector<Sample> samples_;
};

TEST_F(GeneratedSamplesTest, ComeInRealTimeAlsoWithoutFrames) {
  samples_.clear();
  GeneratedSamples source(main_, [this](const Sample& sample) { samples_.push_back(sample); });
  source.on_frame(kBeginNs);
  const auto begin = std::chrono::steady_clock::now();
  while (samples_.size() < 5) main_.run_one();
  EXPECT_GE(std::chrono::steady_clock::now() - begin, std::chrono::milliseconds(15));
  EXPECT_EQ(samples_[4].time_ns, kBeginNs + 20'000'000);
}

TEST_F(GeneratedSamplesTest, Come200TimesASecondFromTheFirstFrameOn) {
  ASSERT_EQ(samples_.size(), 2401U);
  EXPECT_EQ(samples_[0].time_ns, kBeginNs);
  EXPECT_EQ(samples_[2400].time_ns, kBeginNs + 12'000'000'000);
}

TEST_F(GeneratedSamplesTest, EndAlsoWhenOneIsDue) {
  std::optional<GeneratedSamples> source;
  source.emplace(main_, [this](const Sample& sample) { samples_.push_back(sample); });
  source->on_frame(kBeginNs);
  const auto count = samples_.size();
  boost::asio::post(main_, [&] { source.reset(); });  // before the timer, which has expired
  main_.poll();
  EXPECT_EQ(samples_.size(), count);
}

TEST_F(GeneratedSamplesTest, IntegrateToTheTurnOfTheScene) {
  double roll = 0;
  for (std::size_t i = 1; i < samples_.size(); ++i) {
    roll += 0.005 * (samples_[i - 1].angular_velocity[2] + samples_[i].angular_velocity[2]) / 2;
  }
  const double bias = 0.002 * 12;
  EXPECT_NEAR(roll - bias, scene_pose_at(12).roll_rad - scene_pose_at(0).roll_rad, 0.005);
}

TEST_F(GeneratedSamplesTest, IntegrateToThePathOfTheScene) {
  // Along the floor, with the true roll: twice, from the true speed at the begin.
  constexpr double kStep = 1e-4;
  std::array<double, 2> moved{};
  std::array<double, 2> speed{(scene_pose_at(kStep).x - scene_pose_at(0).x) / kStep,
                              (scene_pose_at(kStep).y - scene_pose_at(0).y) / kStep};
  for (std::size_t i = 0; i + 1 < samples_.size(); ++i) {
    const double roll = scene_pose_at(static_cast<double>(i) * 0.005).roll_rad;
    const double x = samples_[i].linear_acceleration[0] - 0.04;
    const double y = samples_[i].linear_acceleration[1] + 0.05;
    speed[0] += 0.005 * (std::cos(roll) * x - std::sin(roll) * y);
    speed[1] += 0.005 * (std::sin(roll) * x + std::cos(roll) * y);
    for (std::size_t axis = 0; axis < 2; ++axis) moved.at(axis) += 0.005 * speed.at(axis);
  }
  EXPECT_NEAR(moved[0], scene_pose_at(12).x - scene_pose_at(0).x, 0.2);
  EXPECT_NEAR(moved[1], scene_pose_at(12).y - scene_pose_at(0).y, 0.2);
}

TEST_F(GeneratedSamplesTest, FeelTheFloorPushUp) {
  double sum = 0;
  for (const Sample& sample : samples_) sum += sample.linear_acceleration[2];
  EXPECT_NEAR(sum / static_cast<double>(samples_.size()), -9.81 + 0.03, 0.02);
}

}  // namespace
}  // namespace orbbuf
