// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/verdict.hpp"

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

TEST(VerdictOf, KeyframesAreEnough) {
  const Trajectory all = placed();
  const Verdict verdict = verdict_of({all[10], all[35], all[55], all[76]}, listed(100));
  EXPECT_FALSE(verdict.is_lost());
  EXPECT_EQ(verdict.starting, 10U);
  EXPECT_EQ(verdict.tracked_share(), 1);
}

TEST(VerdictOf, FramesBetweenPosesOverASecondApartAreNotTracked) {
  const Trajectory all = placed();
  EXPECT_EQ(verdict_of({all[0], all[25], all[51], all[76]}, listed(100)).unplaced, 25U);
}

TEST(VerdictOf, FramesBehindTheLastPoseAreNotTrackedByWhoIsLost) {
  EXPECT_EQ(verdict_of({placed().front()}, listed(100)).unplaced, 99U);
}

TEST(VerdictOf, IsLostWithoutAPoseInTheLastSecond) {
  const Trajectory all = placed();
  EXPECT_FALSE(verdict_of({all[10], all[74]}, listed(100)).is_lost());
  EXPECT_EQ(verdict_of({all[10], all[73]}, listed(100)).lost_at, 74U);
}

TEST(VerdictOf, WithoutAPoseItNeverStarted) {
  const Verdict verdict = verdict_of({}, listed(100));
  EXPECT_EQ(verdict.starting, 100U);
  EXPECT_EQ(verdict.tracked_share(), 0);
}

/// A drive through the generated corridor, half the usual size.
class JudgeOf : public testing::TestWithParam<double> {
 protected:
  JudgeOf() : camera_{190, 190, 159.5, 119.5, 320, 240, GetParam()} {}

  JudgedFrame frame(int i) {
    const double t = 0.1 + i / kFps;
    const Rendered rendered = renderer_.render(t, false);
    return {t, rendered.left, rendered.right};
  }
  Verdict judge(int count, int gap_begin, int gap_end) {
    Judge judge(camera_);
    for (int i = 0; i < count; ++i) {
      if (i < gap_begin || i >= gap_end) judge.see(frame(i), static_cast<std::uint64_t>(i));
    }
    return judge.verdict();
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

TEST_P(JudgeOf, TracksAllOfAnUnbrokenDrive) {
  const int count = turn() + 100;
  const Verdict verdict = judge(count, 0, 0);
  EXPECT_EQ(verdict.unplaced, 0U);
  EXPECT_LT(verdict.starting, 50U);
  const TrajectoryError error = compare(verdict.trajectory, truth(count), !camera_.is_stereo());
  EXPECT_GT(error.path_m, 3);
  EXPECT_LT(error.ate_m, 0.02 * error.path_m);
}

TEST_P(JudgeOf, IsLostWhereFiftyFramesOfATurnAreMissing) {
  const int from = turn();
  const Verdict verdict = judge(from + 80, from, from + 50);
  ASSERT_TRUE(verdict.is_lost());
  EXPECT_EQ(*verdict.lost_at, static_cast<std::uint64_t>(from + 50));
  EXPECT_EQ(verdict.unplaced, 30U);
}

TEST_P(JudgeOf, StandsAFewMissingFrames) {
  const int from = turn();
  EXPECT_FALSE(judge(from + 40, from, from + 4).is_lost());
}

INSTANTIATE_TEST_SUITE_P(MonoAndStereo, JudgeOf, testing::Values(0, 0.12));

}  // namespace
}  // namespace orbbuf::evaluation
