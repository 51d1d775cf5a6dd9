// SPDX-License-Identifier: Apache-2.0
#include "common/calibration/camera_info.hpp"

#include "common/calibration/calibration.hpp"
#include "common/log.hpp"

namespace orbbuf {
namespace {

/// A pinhole that both cameras of a pair become, or the only camera itself.
struct Rectified {
  double fx_px = 0;
  double fy_px = 0;
  double cx_px = 0;
  double cy_px = 0;
  Matrix3 left = kIdentity;   ///< from the left camera to it
  Matrix3 right = kIdentity;  ///< from the right one
  double x_m = 0;             ///< where the right one is
};

Rectified rectified(const Calibration& calibration) {
  const Camera& left = calibration.left;
  Rectified to{left.fx_px, left.fy_px, left.cx_px, left.cy_px};
  if (!calibration.right) return to;
  const Camera& right = *calibration.right;
  const Pose left_from_right = calibration.right_from_left.inverse();
  const Vector3& place = left_from_right.translation_m;
  to.x_m = std::copysign(length(place), place[0]);
  if (calibration.baseline_m() > 0) return to;
  const Vector3 x = scaled(place, 1 / to.x_m);
  const Vector3 forward = row(calibration.right_from_left.rotation, 2);  // the right one's z
  const Vector3 between{forward[0], forward[1], forward[2] + 1};
  const Vector3 down = cross(between, x);
  const Vector3 y = scaled(down, 1 / length(down));
  const Vector3 z = cross(x, y);
  to.left = {x[0], x[1], x[2], y[0], y[1], y[2], z[0], z[1], z[2]};
  to.right = to.left * left_from_right.rotation;
  constexpr double kQuarter = 0.25;
  to.fx_px = to.fy_px = kQuarter * (left.fx_px + left.fy_px + right.fx_px + right.fy_px);
  to.cx_px = (left.cx_px + right.cx_px) / 2;
  to.cy_px = (left.cy_px + right.cy_px) / 2;
  return to;
}

/// x_m: where it is beside the left one, rectified.
CameraInfo camera_info(const Camera& camera, const Rectified& to, const Matrix3& rotation,
                       double x_m) {
  const bool is_fisheye = camera.model == LensModel::kEquidistant;
  const double tx_px = 0 - to.fx_px * x_m;  // the left camera's is 0, not -0
  CameraInfo info;
  info.width_px = static_cast<std::uint32_t>(camera.width_px);
  info.height_px = static_cast<std::uint32_t>(camera.height_px);
  info.distortion_model = is_fisheye ? "equidistant" : "plumb_bob";
  info.distortion = camera.distortion;
  // plumb_bob has a k3, which DSO's RadTan has not; a pinhole is one that bends nothing.
  if (!is_fisheye) info.distortion.resize(5);
  info.k = {camera.fx_px, 0, camera.cx_px, 0, camera.fy_px, camera.cy_px, 0, 0, 1};
  info.r = rotation;
  info.p = {to.fx_px, 0, to.cx_px, tx_px, 0, to.fy_px, to.cy_px, 0, 0, 0, 1, 0};
  return info;
}

}  // namespace

CalibratedCameras calibrated_cameras(std::string_view calibration) {
  CalibratedCameras cameras;
  if (calibration.empty()) return cameras;
  const auto parsed = parse_calibration(calibration);
  if (!parsed) {
    cameras.problem = parsed.error().text;
    return cameras;
  }
  const Calibration& known = parsed.value();
  const std::optional<Camera>& right = known.right;
  if (known.left.model == LensModel::kFov || (right && right->model == LensModel::kFov)) {
    cameras.problem = "FOV is no distortion model of ROS's or Foxglove's";
    return cameras;
  }
  const Rectified to = rectified(known);
  cameras.left = camera_info(known.left, to, to.left, 0);
  if (right) cameras.right = camera_info(*right, to, to.right, to.x_m);
  return cameras;
}

CalibratedCameras calibrated_cameras(std::string_view calibration, std::string_view attempt) {
  auto cameras = calibrated_cameras(calibration);
  if (!cameras.problem.empty()) {
    log_warn("{} without calibration: {}", attempt, cameras.problem);
  }
  return cameras;
}

void warn_without_right_camera(const CalibratedCameras& cameras, std::string_view session) {
  if (!cameras.left || cameras.right) return;
  log_warn(
      "{}: no camera_info of the right camera: the calibration has none (camera.txt: a fifth line, "
      "the "
      "baseline)",
      session);
}

}  // namespace orbbuf
