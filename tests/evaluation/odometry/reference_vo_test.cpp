// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/reference_vo.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "evaluation/world/renderer.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr double kFps = 25;

/// So many frames, 25 a second.
std::vector<ListedFrame> listed(std::size_t count) {
  std::vector<ListedFrame> frames;
  for (std::size_t i = 0; i < count; ++i) frames.push_back({i, static_cast<double>(i) / kFps});
  return frames;
}

/// A pose for each of 100 such frames.
Trajectory placed() {
  Trajectory trajectory;
  for (const ListedFrame& frame : listed(100)) {
    trajectory.push_back({frame.time_s, Eigen::Isometry3d::Identity()});
  }
  return trajectory;
}

TEST(ResultOf, KeyframesAreEnough) {
  const Trajectory all = placed();
  const TrackingResult result = result_of({all[10], all[35], all[55], all[76]}, listed(100));
  EXPECT_FALSE(result.is_lost());
  EXPECT_EQ(result.starting, 10U);
  EXPECT_EQ(result.tracked_share(), 1);
}

TEST(ResultOf, FramesBetweenPosesOverASecondApartAreNotTracked) {
  const Trajectory all = placed();
  EXPECT_EQ(result_of({all[0], all[25], all[51], all[76]}, listed(100)).unplaced, 25U);
}

TEST(ResultOf, FramesBehindTheLastPoseAreNotTrackedByWhoIsLost) {
  EXPECT_EQ(result_of({placed().front()}, listed(100)).unplaced, 99U);
}

TEST(ResultOf, IsLostWithoutAPoseInTheLastSecond) {
  const Trajectory all = placed();
  EXPECT_FALSE(result_of({all[10], all[74]}, listed(100)).is_lost());
  EXPECT_EQ(result_of({all[10], all[73]}, listed(100)).lost_at, 74U);
}

TEST(ResultOf, WithoutAPoseItNeverStarted) {
  const TrackingResult result = result_of({}, listed(100));
  EXPECT_EQ(result.starting, 100U);
  EXPECT_EQ(result.tracked_share(), 0);
}

/// A drive through the generated corridor, half the usual size.
class ReferenceVoOf : public testing::TestWithParam<double> {
 protected:
  ReferenceVoOf() : camera_{190, 190, 159.5, 119.5, 320, 240, GetParam()} {}

  GrayFrame frame(int i) {
    const double t = 0.1 + i / kFps;
    const Rendered rendered = renderer_.render(t, false);
    return {t, rendered.left, rendered.right};
  }
  TrackingResult track(int count, int gap_begin, int gap_end) {
    ReferenceVo vo(camera_);
    for (int i = 0; i < count; ++i) {
      if (i < gap_begin || i >= gap_end) vo.track(frame(i), static_cast<std::uint64_t>(i));
    }
    return vo.result();
  }
  Trajectory truth(int count) {
    Trajectory trajectory;
    for (int i = 0; i < count; ++i) {
      const double t = 0.1 + i / kFps;
      const CameraPose at = renderer_.route().at(t);
      Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
      const double c = std::cos(at.heading);
      const double s = std::sin(at.heading);
      pose.linear() << s, 0, c, -c, 0, s, 0, -1, 0;
      pose.translation() = Eigen::Vector3d(at.x, at.y, at.z);
      trajectory.push_back({t, pose});
    }
    return trajectory;
  }
  /// The first frame of the first turn on the spot.
  int turn() {
    for (int i = 50;; ++i) {
      const Route& route = renderer_.route();
      if (std::abs(route.at(i / kFps).heading - route.at((i - 10) / kFps).heading) > 0.15) return i;
    }
  }

  Camera camera_;
  Renderer renderer_{kCorridor, camera_, 1, 20};
};

TEST_P(ReferenceVoOf, TracksAllOfAnUnbrokenDrive) {
  const int count = turn() + 100;
  const TrackingResult result = track(count, 0, 0);
  EXPECT_EQ(result.unplaced, 0U);
  EXPECT_LT(result.starting, 50U);
  const TrajectoryError error = compare(result.trajectory, truth(count), !camera_.is_stereo());
  EXPECT_GT(error.path_m, 3);
  EXPECT_LT(error.ate_m, 0.02 * error.path_m);
}

TEST_P(ReferenceVoOf, IsLostWhereFiftyFramesOfATurnAreMissing) {
  const int from = turn();
  const TrackingResult result = track(from + 80, from, from + 50);
  ASSERT_TRUE(result.is_lost());
  EXPECT_EQ(*result.lost_at, static_cast<std::uint64_t>(from + 50));
  EXPECT_EQ(result.unplaced, 30U);
}

TEST_P(ReferenceVoOf, StandsAFewMissingFrames) {
  const int from = turn();
  EXPECT_FALSE(track(from + 40, from, from + 4).is_lost());
}

INSTANTIATE_TEST_SUITE_P(MonoAndStereo, ReferenceVoOf, testing::Values(0, 0.12));

}  // namespace
}  // namespace orbbuf::evaluation
