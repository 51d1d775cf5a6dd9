// SPDX-License-Identifier: Apache-2.0
#include "common/calibration/camera_info.hpp"

#include <gmock/gmock.h>

#include <array>
#include <string>
#include <vector>

#include "testing/captured_log.hpp"

namespace orbbuf {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::StartsWith;

std::string camera_txt(const std::string& model, const std::string& baseline_m = "0.5\n") {
  return model + "\n160 120\nnone\n160 120\n" + baseline_m;
}

TEST(CameraInfo, APinholeIsAPlumbBobThatBendsNothing) {
  const auto info = calibrated_cameras(camera_txt("Pinhole 100 101 80 60 0")).left.value();
  EXPECT_EQ(info.width_px, 160U);
  EXPECT_EQ(info.height_px, 120U);
  EXPECT_EQ(info.distortion_model, "plumb_bob");
  EXPECT_EQ(info.distortion, std::vector<double>(5));
  EXPECT_EQ(info.k, (std::array<double, 9>{100, 0, 80, 0, 101, 60, 0, 0, 1}));
}

TEST(CameraInfo, ARadTanHasNoK3) {
  const auto info = calibrated_cameras(camera_txt("RadTan 100 101 80 60 1 2 3 4")).left.value();
  EXPECT_EQ(info.distortion_model, "plumb_bob");
  EXPECT_EQ(info.distortion, (std::vector<double>{1, 2, 3, 4, 0}));
}

TEST(CameraInfo, TheFisheyeKeepsItsFourNumbers) {
  const auto fisheye = camera_txt("EquiDistant 100 101 80 60 0.1 0.2 0.3 0.4");
  const auto info = calibrated_cameras(fisheye).left.value();
  EXPECT_EQ(info.distortion_model, "equidistant");
  EXPECT_EQ(info.distortion, (std::vector<double>{0.1, 0.2, 0.3, 0.4}));
}

TEST(CameraInfo, TheRightCameraIsTheLeftOneMovedByTheBaseline) {
  const auto stereo = calibrated_cameras(camera_txt("Pinhole 100 101 80 60 0"));
  EXPECT_EQ(stereo.left->p, (std::array<double, 12>{100, 0, 80, 0, 0, 101, 60, 0, 0, 0, 1, 0}));
  EXPECT_EQ(stereo.right->p, (std::array<double, 12>{100, 0, 80, -50, 0, 101, 60, 0, 0, 0, 1, 0}));
}

TEST(CameraInfo, AStereoCameraWithoutABaselineIsLogged) {
  const test::CapturedLog log;
  warn_without_right_camera(calibrated_cameras(camera_txt("Pinhole 100 101 80 60 0")), "r s");
  warn_without_right_camera(calibrated_cameras(camera_txt("FOV 100 101 80 60 0.9", "")), "r s");
  warn_without_right_camera(calibrated_cameras(""), "r s");
  EXPECT_TRUE(log.lines().empty());
  warn_without_right_camera(calibrated_cameras(camera_txt("Pinhole 100 101 80 60 0", "")), "r s");
  EXPECT_THAT(log.lines(), ElementsAre(HasSubstr("r s: no camera_info of the right camera")));
}

TEST(CameraInfo, NothingIsMadeUp) {
  const auto unknown_baseline = calibrated_cameras(camera_txt("Pinhole 100 101 80 60 0", ""));
  EXPECT_TRUE(unknown_baseline.left);
  EXPECT_FALSE(unknown_baseline.right);
  const auto bent = calibrated_cameras(camera_txt("FOV 100 101 80 60 0.9"));
  EXPECT_FALSE(bent.left || bent.right);
  EXPECT_THAT(bent.problem, HasSubstr("FOV is no distortion model"));
  const auto torn = calibrated_cameras("Pinhole 100");
  EXPECT_FALSE(torn.left || torn.right);
  EXPECT_THAT(torn.problem, StartsWith("camera.txt: "));
  const auto none = calibrated_cameras("");
  EXPECT_FALSE(none.left || none.right);
  EXPECT_EQ(none.problem, "");
}

}  // namespace
}  // namespace orbbuf
