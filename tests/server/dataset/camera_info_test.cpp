// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/camera_info.hpp"

#include <gtest/gtest.h>

#include <utility>

#include "server/dataset/calibration.hpp"

namespace orbbuf {
namespace {

Calibration camera_of(LensModel model, std::vector<double> distortion, double baseline_m = 0.5) {
  return {model, "name", 100, 101, 80, 60, std::move(distortion), 160, 120, baseline_m};
}

TEST(CameraInfo, APinholeIsAPlumbBobThatBendsNothing) {
  const auto info = camera_info(camera_of(LensModel::kPinhole, {}), Side::kLeft).value();
  EXPECT_EQ(info.width_px, 160U);
  EXPECT_EQ(info.height_px, 120U);
  EXPECT_EQ(info.distortion_model, "plumb_bob");
  EXPECT_EQ(info.distortion, std::vector<double>(5));
  EXPECT_EQ(info.k, (std::array<double, 9>{100, 0, 80, 0, 101, 60, 0, 0, 1}));
}

TEST(CameraInfo, ARadTanHasNoK3) {
  const auto info = camera_info(camera_of(LensModel::kRadTan, {1, 2, 3, 4}), Side::kLeft).value();
  EXPECT_EQ(info.distortion_model, "plumb_bob");
  EXPECT_EQ(info.distortion, (std::vector<double>{1, 2, 3, 4, 0}));
}

TEST(CameraInfo, TheFisheyeKeepsItsFourNumbers) {
  const auto fisheye = camera_of(LensModel::kEquidistant, {0.1, 0.2, 0.3, 0.4});
  const auto info = camera_info(fisheye, Side::kLeft).value();
  EXPECT_EQ(info.distortion_model, "equidistant");
  EXPECT_EQ(info.distortion, (std::vector<double>{0.1, 0.2, 0.3, 0.4}));
}

TEST(CameraInfo, TheRightCameraIsTheLeftOneMovedByTheBaseline) {
  const auto stereo = camera_of(LensModel::kPinhole, {});
  EXPECT_EQ(camera_info(stereo, Side::kLeft)->p,
            (std::array<double, 12>{100, 0, 80, 0, 0, 101, 60, 0, 0, 0, 1, 0}));
  EXPECT_EQ(camera_info(stereo, Side::kRight)->p,
            (std::array<double, 12>{100, 0, 80, -50, 0, 101, 60, 0, 0, 0, 1, 0}));
}

TEST(CameraInfo, NothingIsMadeUp) {
  EXPECT_FALSE(camera_info(camera_of(LensModel::kFov, {0.9}), Side::kLeft));
  const auto unknown_baseline = camera_of(LensModel::kPinhole, {}, 0);
  EXPECT_TRUE(camera_info(unknown_baseline, Side::kLeft));
  EXPECT_FALSE(camera_info(unknown_baseline, Side::kRight));
}

}  // namespace
}  // namespace orbbuf
