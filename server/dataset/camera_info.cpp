// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/camera_info.hpp"

#include "server/dataset/calibration.hpp"

namespace orbbuf {

std::optional<CameraInfo> camera_info(const Calibration& camera, Side side) {
  const bool is_right = side == Side::kRight;
  if (camera.model == LensModel::kFov || (is_right && camera.baseline_m <= 0)) return std::nullopt;
  const bool is_fisheye = camera.model == LensModel::kEquidistant;
  const double tx_px = is_right ? -camera.fx_px * camera.baseline_m : 0;
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

CalibratedCameras calibrated_cameras(const Calibration& camera) {
  return {camera_info(camera, Side::kLeft), camera_info(camera, Side::kRight)};
}

}  // namespace orbbuf
