// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

// Compiles as C++17, too, for ROS 1.
namespace orbbuf {

/// A camera as sensor_msgs/CameraInfo and foxglove.CameraCalibration describe it.
struct CameraInfo {
  std::uint32_t width_px = 0;
  std::uint32_t height_px = 0;
  std::string distortion_model;    ///< as ROS calls it: plumb_bob or equidistant
  std::vector<double> distortion;  ///< D: five numbers, or four
  std::array<double, 9> k{};       ///< row by row, in pixels
  /// Row by row: from the camera to the rectified one.
  std::array<double, 9> r{1, 0, 0, 0, 1, 0, 0, 0, 1};
  std::array<double, 12> p{};  ///< row by row, rectified; of the right camera, with its place
};

/// What can be told of a session's cameras.
struct CalibratedCameras {
  std::optional<CameraInfo> left;  ///< or the only one
  std::optional<CameraInfo> right;
  std::string problem;  ///< why there is nothing, though there is a calibration
};

/// A pair that is not rectified gets a common camera (Fusiello, Trucco and Verri 2000: x along the
/// baseline, z between both, the middle of both lenses). Nothing of DSO's FOV, which has no name
/// there, nor of a right camera whose position is unknown. calibration: as parse_calibration()
/// reads it; empty if there is none.
CalibratedCameras calibrated_cameras(std::string_view calibration);

/// The same; a problem is logged as `ATTEMPT without calibration: PROBLEM`.
CalibratedCameras calibrated_cameras(std::string_view calibration, std::string_view attempt);

/// For stereo frames: logs for SESSION if there is no right camera since the calibration has none.
void warn_without_right_camera(const CalibratedCameras& cameras, std::string_view session);

}  // namespace orbbuf
