// SPDX-License-Identifier: Apache-2.0
#include "evaluation/outages/judge.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace orbbuf::evaluation {
namespace {

/// On a square, a corner a second; the heights are those corners' errors.
Trajectory square(const std::vector<double>& heights) {
  const double x[] = {1, 0, -1, 0};
  Trajectory trajectory;
  for (std::size_t i = 0; i < heights.size(); ++i) {
    StampedPose& stamped = trajectory.emplace_back();
    stamped.time_s = static_cast<double>(i);
    stamped.pose.translation() = Eigen::Vector3d(x[i % 4], x[(i + 3) % 4], heights[i]);
  }
  return trajectory;
}

const Trajectory kTruth = square({0, 0, 0, 0});

Trajectory turned(double degrees) {
  Trajectory trajectory = kTruth;
  for (std::size_t i = 2; i < trajectory.size(); ++i) {
    trajectory[i].pose.rotate(
        Eigen::AngleAxisd(degrees * std::numbers::pi / 180, Eigen::Vector3d::UnitZ()));
  }
  return trajectory;
}

/// A frame each second; an outage from 1 to 1.5, live again at 2.
OutageList list_of(std::size_t count) {
  OutageList list;
  list.begin_s = 1;
  list.length_s = 0.5;
  list.lateness_s = 0.5;
  for (std::size_t i = 0; i < count; ++i) list.arrivals.push_back({"", i, static_cast<double>(i)});
  return list;
}

Criteria floor_of(double ate_m) {
  Criteria criteria;
  criteria.ate_floor = ate_m;
  criteria.is_mono = false;
  return criteria;
}

TEST(Judge, ErrorsAreRightToTheDigit) {
  // Heights of +-0.75 in turns: nothing that a rotation or a shift could take away.
  const Trajectory off = square({0.75, -0.75, 0.75, -0.75});
  const Judgement metric = judge(list_of(4), off, kTruth, kTruth, floor_of(0.75));
  EXPECT_NEAR(metric.error.ate_m, 0.75, 1e-12);
  EXPECT_NEAR(metric.error.rpe_m, 1.5, 1e-12);
  EXPECT_NEAR(metric.error.rpe_deg, 0, 1e-6);
  EXPECT_EQ(metric.error.poses, 4U);
  EXPECT_TRUE(metric.is_survived);
  EXPECT_FALSE(judge(list_of(4), off, kTruth, kTruth, floor_of(0.7499)).is_survived);
  // With a free scale s = 1 / (1 + 0.75^2) = 0.64, and the error is 0.75 / sqrt(1 + 0.75^2).
  Criteria mono = floor_of(0.6001);
  mono.is_mono = true;
  const Judgement scaled = judge(list_of(4), off, kTruth, kTruth, mono);
  EXPECT_NEAR(scaled.error.scale, 0.64, 1e-12);
  EXPECT_NEAR(scaled.error.ate_m, 0.6, 1e-12);
  EXPECT_NEAR(scaled.error.rpe_m, std::sqrt(2 * 0.36 * 0.36 + 0.96 * 0.96), 1e-12);
  EXPECT_TRUE(scaled.is_survived);
}

TEST(Judge, TheRotationOverTheOutageCounts) {
  const Judgement five = judge(list_of(4), turned(5), kTruth, kTruth, floor_of(0.1));
  EXPECT_NEAR(five.turn_deg, 5, 1e-6);
  EXPECT_NEAR(five.error.rpe_deg, 5 / std::sqrt(3), 1e-6);
  EXPECT_TRUE(five.is_survived);
  EXPECT_FALSE(judge(list_of(4), turned(10), kTruth, kTruth, floor_of(0.1)).is_survived);
  // As much more than the unbroken run's.
  EXPECT_TRUE(judge(list_of(4), turned(10), turned(5), kTruth, floor_of(0.1)).is_survived);
}

TEST(Judge, TheUnbrokenRunIsTheMeasure) {
  const Trajectory unbroken = square({0.2, -0.2, 0.2, -0.2});
  const auto survives = [&](double height) {
    return judge(list_of(4), square({height, -height, height, -height}), unbroken, kTruth,
                 floor_of(0))
        .is_survived;
  };
  EXPECT_TRUE(survives(0.59));
  EXPECT_FALSE(survives(0.61));
}

TEST(Judge, WhoStopsIsLostAndWhoComesBackIsRelocalised) {
  const std::vector<double> flat(9, 0.0);
  const Trajectory whole = square(flat);
  const auto judged = [&](std::vector<std::size_t> missing) {
    Trajectory estimate;
    for (std::size_t i = 0; i < whole.size(); ++i) {
      if (std::ranges::find(missing, i) == missing.end()) estimate.push_back(whole[i]);
    }
    return judge(list_of(9), estimate, whole, whole, floor_of(0.1));
  };
  EXPECT_TRUE(judged({}).is_survived);
  EXPECT_TRUE(judged({3, 4}).is_survived);  // a pause of no more than a second
  const Judgement paused = judged({3, 4, 5});
  EXPECT_FALSE(paused.is_survived);
  EXPECT_TRUE(paused.is_relocalised);
  const Judgement stopped = judged({5, 6, 7, 8});
  EXPECT_FALSE(stopped.is_survived);
  EXPECT_FALSE(stopped.is_relocalised);
  EXPECT_FALSE(judged({0, 1, 2, 3, 4, 5, 6, 7, 8}).is_survived);
}

TEST(TurnError, IsUnknownWithoutAPoseOnEachSide) {
  EXPECT_TRUE(turn_error_deg(kTruth, kTruth, 1, 2));
  EXPECT_FALSE(turn_error_deg(kTruth, kTruth, -1, 2));
  EXPECT_FALSE(turn_error_deg(kTruth, kTruth, 1, 3.5));
}

TEST(Paired, CountsThePlacesOfBoth) {
  const Survived first{{"a", true}, {"b", true}, {"c", false}, {"d", false}, {"e", true}};
  const Survived second{{"a", true}, {"b", false}, {"c", true}, {"d", false}, {"f", true}};
  const Paired paired = compare_places(first, second);
  EXPECT_EQ(paired.both, 1U);
  EXPECT_EQ(paired.only_first, 1U);
  EXPECT_EQ(paired.only_second, 1U);
  EXPECT_EQ(paired.neither, 1U);
  EXPECT_EQ(share_of(first).some, 3U);
  EXPECT_EQ(share_of(first).all, 5U);
}

TEST(Paired, HasTheProbabilityOfTheSignTest) {
  EXPECT_DOUBLE_EQ((Paired{9, 17, 1, 3}.p_value()), 2 * 19 / std::pow(2, 18));
  EXPECT_DOUBLE_EQ((Paired{0, 0, 5, 0}.p_value()), 2 / 32.0);
  EXPECT_DOUBLE_EQ((Paired{0, 3, 3, 0}.p_value()), 1);
  EXPECT_DOUBLE_EQ((Paired{7, 0, 0, 7}.p_value()), 1);
}

}  // namespace
}  // namespace orbbuf::evaluation
