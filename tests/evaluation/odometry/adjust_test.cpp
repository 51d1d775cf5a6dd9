// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/adjust.hpp"

#include <gtest/gtest.h>

#include <vector>

#include "evaluation/odometry/resection.hpp"

namespace orbbuf::evaluation {
namespace {

TEST(Adjust, BringsAMovedKeyframeBack) {
  const Camera camera{190, 190, 159.5, 119.5, 320, 240, 0.1};
  Keyframes keyframes(3, Eigen::Isometry3d::Identity());
  keyframes[1].translation().x() = -0.2;
  keyframes[2].translation().x() = -0.4;
  std::vector<Track> tracks(40);
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    tracks[i].has_point = true;
    tracks[i].point = {static_cast<double>(i % 8) * 0.3 - 1, static_cast<double>(i % 5) * 0.3 - 0.6,
                       3 + static_cast<double>(i % 7) * 0.4};
    for (std::size_t k = 0; k < 3; ++k) {
      tracks[i].seen.push_back({k, *project(camera, keyframes[k], tracks[i].point), -1});
    }
  }
  const Eigen::Isometry3d really = keyframes[2];
  keyframes[2].translation() += Eigen::Vector3d(0.05, -0.03, 0.08);
  adjust(camera, keyframes, tracks, 8, 2);
  EXPECT_LT((keyframes[2].translation() - really.translation()).norm(), 1e-3);
}

}  // namespace
}  // namespace orbbuf::evaluation
