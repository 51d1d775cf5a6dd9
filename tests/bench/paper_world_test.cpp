// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numbers>
#include <stdexcept>

#include "bench/paper/world/renderer.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf::paper {
namespace {

constexpr Camera kMono{190, 190, 159.5, 119.5, 320, 240, 0};
constexpr double kDuration_s = 30;

Camera stereo() {
  Camera camera = kMono;
  camera.baseline_m = 0.12;
  return camera;
}

TEST(Route, MovesAndTurnsWithoutJumps) {
  const Route route(kCorridor, 1, kDuration_s);
  double turned = 0;
  for (double t = 0; t < kDuration_s - 0.01; t += 0.01) {
    const CameraPose a = route.at(t);
    const CameraPose b = route.at(t + 0.01);
    EXPECT_LT(std::hypot(b.x - a.x, b.y - a.y), 0.03) << t;
    EXPECT_LT(std::abs(b.heading - a.heading), 0.03) << t;
    turned += std::abs(b.heading - a.heading);
  }
  EXPECT_GT(turned, std::numbers::pi);  // there are turns in it
}

TEST(Route, StaysInTheOpen) {
  for (const Style& style : {kCorridor, kStreet}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const Route route(style, seed, kDuration_s);
      const Place place(style, route, seed);
      for (double t = 0; t < kDuration_s; t += 0.05) {
        const CameraPose pose = route.at(t);
        EXPECT_TRUE(place.is_free({static_cast<int>(std::lround(pose.x / style.cell_m)),
                                   static_cast<int>(std::lround(pose.y / style.cell_m))}))
            << "seed " << seed << " at " << t;
      }
    }
  }
}

TEST(Place, TellsHowFarTheWallIs) {
  const Route route(kCorridor, 1, kDuration_s);
  const Place place(kCorridor, route, 1);
  const WallHit hit = place.look(0, 0, -2, 0);  // distances are in units of 2 m
  int free_cells = 1;
  while (place.is_free({-free_cells, 0})) ++free_cells;
  EXPECT_GE(free_cells, 2);
  EXPECT_NEAR(hit.distance_m, (free_cells - 0.5) / 2, 1e-9);
  EXPECT_TRUE(hit.faces_x);
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

TEST(CameraFile, ComesBackAsWritten) {
  const test::TemporaryFolder folder;
  for (const Camera& camera : {kMono, stereo()}) {
    std::ofstream(folder.path() / "camera.txt") << to_text(camera);
    const Camera read = read_camera(folder.path() / "camera.txt");
    EXPECT_EQ(read.cy, 119.5);
    EXPECT_EQ(read.height_px, 240);
    EXPECT_EQ(read.baseline_m, camera.baseline_m);
  }
}

TEST(CameraFile, OtherModelsAreRefused) {
  const test::TemporaryFolder folder;
  std::ofstream(folder.path() / "camera.txt")
      << "FOV 0.5 0.7 0.5 0.5 0.9\n640 480\ncrop\n640 480\n";
  EXPECT_THROW(read_camera(folder.path() / "camera.txt"), std::runtime_error);
}

}  // namespace
}  // namespace orbbuf::paper
