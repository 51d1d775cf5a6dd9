// SPDX-License-Identifier: Apache-2.0
#include "server/calibration/camera_info.hpp"

#include "common/log.hpp"
#include "server/calibration/calibration.hpp"

namespace orbbuf {
namespace {

/// Of the camera that is `x_m` to the right of the left one.
CameraInfo camera_info(const Calibration& camera, double x_m) {
  const bool is_fisheye = camera.model == LensModel::kEquidistant;
  const double tx_px = 0 - camera.fx_px * x_m;  // the left camera's is 0, not -0
  CameraInfo info;
  info.width_px = static_cast<std::uint32_t>(camera.width_px);
  info.height_px = static_cast<std::uint32_t>(camera.height_px);
  info.distortion_model = is_fisheye ? "equidistant" : "plumb_bob";
  info.distortion = camera.distortion;
  // plumb_bob has a k3, which DSO's RadTan has not; a pinhole is one that bends nothing.
  if (!is_fisheye) info.distortion.resize(5);
  info.k = {camera.fx_px, 0, camera.cx_px, 0, camera.fy_px, camera.cy_px, 0, 0, 1};
  info.p = {camera.fx_px, 0, camera.cx_px, tx_px, 0, camera.fy_px, camera.cy_px, 0, 0, 0, 1, 0};
  return info;
}

}  // namespace

CalibratedCameras calibrated_cameras(std::string_view camera_txt) {
  CalibratedCameras cameras;
  if (camera_txt.empty()) return cameras;
  const auto parsed = parse_calibration(camera_txt);
  if (!parsed) {
    cameras.problem = "camera.txt: " + parsed.error().text;
    return cameras;
  }
  const Calibration& camera = parsed.value();
  if (camera.model == LensModel::kFov) {
    cameras.problem =
        "camera.txt: " + camera.name + " is no distortion model of ROS's or Foxglove's";
    return cameras;
  }
  cameras.left = camera_info(camera, 0);
  if (camera.baseline_m > 0) cameras.right = camera_info(camera, camera.baseline_m);
  return cameras;
}

CalibratedCameras calibrated_cameras(std::string_view camera_txt, std::string_view attempt) {
  auto cameras = calibrated_cameras(camera_txt);
  if (!cameras.problem.empty()) {
    log_warn("{} without calibration: {}", attempt, cameras.problem);
  }
  return cameras;
}

void warn_without_baseline(const CalibratedCameras& cameras, std::string_view session) {
  if (!cameras.left || cameras.right) return;
  log_warn("{}: no camera_info of the right camera: camera.txt has no fifth line, the baseline",
           session);
}

}  // namespace orbbuf
