// SPDX-License-Identifier: Apache-2.0
#include "evaluation/world/renderer.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace orbbuf::evaluation {
namespace {

constexpr Camera kMono{190, 190, 159.5, 119.5, 320, 240, 0};
constexpr double kDuration_s = 30;

Camera stereo() {
  Camera camera = kMono;
  camera.baseline_m = 0.12;
  return camera;
}

TEST(Renderer, GivesTheSameImageForTheSameSeedOnly) {
  const Renderer one(kCorridor, kMono, 1, kDuration_s);
  const Renderer same(kCorridor, kMono, 1, kDuration_s);
  const Renderer other(kCorridor, kMono, 2, kDuration_s);
  const cv::Mat image = one.render(3, false).left;
  EXPECT_EQ(cv::norm(image, same.render(3, false).left, cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(image, other.render(3, false).left, cv::NORM_L1) / 76800, 10);
}

/// What the left camera sees at some depth the right one sees by that depth's disparity aside.
TEST(Renderer, DepthExplainsTheRightImage) {
  const Renderer renderer(kCorridor, stereo(), 1, kDuration_s);
  const Rendered frame = renderer.render(2, true);
  double with_depth = 0;
  double without = 0;
  for (int y = 0; y < 240; ++y) {
    for (int x = 60; x < 320; ++x) {
      const double disparity = 190 * 0.12 / frame.depth.at<float>(y, x);
      const int there = std::max(0, static_cast<int>(std::lround(x - disparity)));
      with_depth += std::abs(frame.left.at<uchar>(y, x) - frame.right.at<uchar>(y, there));
      without += std::abs(frame.left.at<uchar>(y, x) - frame.right.at<uchar>(y, x));
    }
  }
  EXPECT_LT(with_depth, 0.4 * without);
}

TEST(Renderer, ExposureChanges) {
  const Renderer renderer(kCorridor, kMono, 1, kDuration_s);
  double lowest = 10;
  double highest = 0;
  for (double t = 0; t < kDuration_s; t += 0.1) {
    lowest = std::min(lowest, renderer.gain(t));
    highest = std::max(highest, renderer.gain(t));
  }
  EXPECT_GT(highest / lowest, 1.3);
}

}  // namespace
}  // namespace orbbuf::evaluation
