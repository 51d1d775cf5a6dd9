// SPDX-License-Identifier: Apache-2.0
#include "evaluation/odometry/resection.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace orbbuf::evaluation {
namespace {

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

}  // namespace
}  // namespace orbbuf::evaluation
