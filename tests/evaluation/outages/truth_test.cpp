// SPDX-License-Identifier: Apache-2.0
#include "evaluation/outages/truth.hpp"

#include <gtest/gtest.h>

#include <fstream>
#include <numbers>

#include "testing/temporary_folder.hpp"

namespace orbbuf::evaluation {
namespace {

TEST(Truth, IsInterpolatedBetweenThePosesOfTum) {
  const test::TemporaryFolder folder;
  // A quarter turn about z in half a second; then nothing for 2 s.
  std::ofstream(folder / "truth.txt") << "# time x y z qx qy qz qw\n"
                                         "10.0 0 0 0 0 0 0 1\n"
                                         "10.5 2 0 0 0 0 0.70710678118 0.70710678118\n"
                                         "12.5 2 0 0 0 0 0.70710678118 0.70710678118\n";
  const auto poses = truth_of_frames(folder / "truth.txt", {9.0, 10.0, 10.25, 11.0, 12.5004});
  ASSERT_EQ(poses.size(), 5U);
  EXPECT_FALSE(poses[0]);
  ASSERT_TRUE(poses[1]);
  EXPECT_EQ(poses[1]->translation().x(), 0);
  ASSERT_TRUE(poses[2]);
  EXPECT_NEAR(poses[2]->translation().x(), 1, 1e-9);
  EXPECT_NEAR(Eigen::AngleAxisd(poses[2]->rotation()).angle(), std::numbers::pi / 4, 1e-9);
  EXPECT_FALSE(poses[3]);
  EXPECT_TRUE(poses[4]);
}

TEST(Truth, HasALineOfKittiForEachFrame) {
  const test::TemporaryFolder folder;
  std::ofstream(folder / "05.txt") << "1 0 0 3 0 1 0 4 0 0 1 5\n"
                                      "0 -1 0 0 1 0 0 0 0 0 1 7\n";
  const auto poses = truth_of_frames(folder / "05.txt", {0.0, 0.1, 0.2});
  ASSERT_EQ(poses.size(), 3U);
  EXPECT_EQ(poses[0]->translation(), Eigen::Vector3d(3, 4, 5));
  EXPECT_EQ(poses[1]->translation().z(), 7);
  EXPECT_EQ(poses[1]->rotation() * Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitY());
  EXPECT_FALSE(poses[2]);
}

}  // namespace
}  // namespace orbbuf::evaluation
