// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>

#include "bench/paper/judge/adjust.hpp"
#include "bench/paper/judge/frames.hpp"
#include "bench/paper/judge/resection.hpp"
#include "bench/paper/judge/verdict.hpp"
#include "bench/paper/world/renderer.hpp"

namespace orbbuf::paper {
namespace {

constexpr double kFps = 25;

Trajectory circle(double scale, double turn) {
  Trajectory trajectory;
  const Eigen::AngleAxisd whole(turn, Eigen::Vector3d(1, 2, 3).normalized());
  for (int i = 0; i < 100; ++i) {
    StampedPose& stamped = trajectory.emplace_back();
    stamped.time_s = i / kFps;
    const double angle = i * 0.05;
    stamped.pose.translation() =
        whole *
        Eigen::Vector3d(scale * std::cos(angle), scale * std::sin(angle), 0.1 * scale * angle);
    stamped.pose.linear() =
        (whole * Eigen::AngleAxisd(angle, Eigen::Vector3d::UnitZ())).toRotationMatrix();
  }
  return trajectory;
}

TEST(Trajectory, AlignedCopiesDoNotDiffer) {
  const TrajectoryError error = compare(circle(0.25, 1), circle(1, 0), true);
  EXPECT_EQ(error.poses, 100U);
  EXPECT_NEAR(error.scale, 4, 1e-9);
  EXPECT_LT(error.ate_m, 1e-9);
  EXPECT_LT(error.rpe_m, 1e-9);
}

TEST(Trajectory, WrongScaleIsAnErrorWhereItIsKnown) {
  const TrajectoryError error = compare(circle(0.9, 1), circle(1, 0), false);
  EXPECT_NEAR(error.scale, 1, 1e-9);
  EXPECT_GT(error.ate_m, 0.01);
}

TEST(Trajectory, AteIsWhatOnePoseIsOff) {
  Trajectory off = circle(1, 0);
  off[50].pose.translation().z() += 1;
  const double ate = compare(off, circle(1, 0), false).ate_m;
  EXPECT_NEAR(ate, 0.1, 0.01);  // the root of 1/100, but for what alignment takes
}

TEST(Resection, FindsThePoseAmongOutliers) {
  const Camera camera{190, 190, 159.5, 119.5, 320, 240, 0};
  Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
  pose.linear() = Eigen::AngleAxisd(0.2, Eigen::Vector3d::UnitY()).matrix();
  pose.translation() = Eigen::Vector3d(0.3, -0.1, 0.4);
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> pixels;
  for (int i = 0; i < 60; ++i) {
    const Eigen::Vector3d point((i % 8) * 0.3 - 1, (i % 5) * 0.3 - 0.6, 3 + (i % 7) * 0.4);
    const auto pixel = project(camera, pose, point);
    ASSERT_TRUE(pixel);
    const double wrong = i % 3 == 0 ? 40 + i : 0;
    points.emplace_back(point.x(), point.y(), point.z());
    pixels.emplace_back(pixel->x() + wrong, pixel->y());
  }
  const auto found = resect(camera, points, pixels);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->inliers.size(), 40U);
  EXPECT_LT((found->pose.translation() - pose.translation()).norm(), 1e-3);
}

TEST(Triangulate, RefusesRaysThatAreNearlyParallel) {
  const Camera camera{190, 190, 159.5, 119.5, 320, 240, 0};
  const Eigen::Isometry3d here = Eigen::Isometry3d::Identity();
  Eigen::Isometry3d there = here;
  there.translation().x() = -0.2;
  const Eigen::Vector3d point(0.5, 0.2, 4);
  const auto found = triangulate(camera, here, *project(camera, here, point), there,
                                 *project(camera, there, point), 1);
  ASSERT_TRUE(found);
  EXPECT_LT((*found - point).norm(), 1e-6);
  EXPECT_FALSE(triangulate(camera, here, *project(camera, here, point), there,
                           *project(camera, there, point), 5));
}

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

/// So many frames, 25 a second.
std::vector<ListedFrame> listed(std::size_t count) {
  std::vector<ListedFrame> frames;
  for (std::size_t i = 0; i < count; ++i) frames.push_back({i, static_cast<double>(i) / kFps});
  return frames;
}

TEST(VerdictOf, KeyframesAreEnough) {
  const Trajectory all = circle(1, 0);
  const Verdict verdict = verdict_of({all[10], all[35], all[55], all[76]}, listed(100));
  EXPECT_FALSE(verdict.is_lost());
  EXPECT_EQ(verdict.starting, 10U);
  EXPECT_EQ(verdict.tracked_share(), 1);
}

TEST(VerdictOf, FramesBetweenPosesOverASecondApartAreNotTracked) {
  const Trajectory all = circle(1, 0);
  EXPECT_EQ(verdict_of({all[0], all[25], all[51], all[76]}, listed(100)).unplaced, 25U);
}

TEST(VerdictOf, FramesBehindTheLastPoseAreNotTrackedByWhoIsLost) {
  EXPECT_EQ(verdict_of({circle(1, 0).front()}, listed(100)).unplaced, 99U);
}

TEST(VerdictOf, IsLostWithoutAPoseInTheLastSecond) {
  const Trajectory all = circle(1, 0);
  EXPECT_FALSE(verdict_of({all[10], all[74]}, listed(100)).is_lost());
  EXPECT_EQ(verdict_of({all[10], all[73]}, listed(100)).lost_at, 74U);
}

TEST(VerdictOf, WithoutAPoseItNeverStarted) {
  const Verdict verdict = verdict_of({}, listed(100));
  EXPECT_EQ(verdict.starting, 100U);
  EXPECT_EQ(verdict.tracked_share(), 0);
}

/// A pipe's bytes, all of them there.
std::unique_ptr<std::FILE, int (*)(std::FILE*)> piped(std::string& bytes) {
  return {::fmemopen(bytes.data(), bytes.size(), "r"), std::fclose};
}

TEST(Pipe, IsReadAsTheServerWritesIt) {
  std::string bytes =
      "P5\n# seq=7\n# t=12.500000000\n# session=s\n# camera=left\n2 1\n255\nab"
      "P5\n# seq=7\n# t=12.500000000\n# session=s\n# camera=right\n2 1\n255\n#d";
  const auto in = piped(bytes);
  Pipe pipe(in.get());
  const auto next = pipe.next(true);
  ASSERT_TRUE(next);
  EXPECT_EQ(next->id, 7U);
  EXPECT_EQ(next->frame.time_s, 12.5);
  EXPECT_EQ(next->frame.left.at<uchar>(0, 1), 'b');
  EXPECT_EQ(next->frame.right.at<uchar>(0, 0), '#');
  EXPECT_FALSE(pipe.next(true));
}

TEST(Pipe, CutShortIsAnError) {
  std::string bytes = "P5\n# seq=0\n# t=1.000000000\n# session=s\n2 1\n255\na";
  const auto in = piped(bytes);
  EXPECT_THROW(Pipe(in.get()).next(false), std::runtime_error);
}

TEST(Pipe, OfOneCameraIsNotStereo) {
  std::string bytes = "P5\n# seq=0\n# t=1.000000000\n# session=s\n1 1\n255\na";
  const auto in = piped(bytes);
  EXPECT_THROW(Pipe(in.get()).next(true), std::runtime_error);
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
}  // namespace orbbuf::paper
