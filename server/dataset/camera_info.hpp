// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

// Compiles as C++17, too, for ROS 1.
namespace orbbuf {

struct Calibration;

/// Which camera of a stereo pair; kLeft is also the only one.
enum class Side : std::uint8_t { kLeft, kRight };

/// A camera as sensor_msgs/CameraInfo and foxglove.CameraCalibration describe it.
struct CameraInfo {
  std::uint32_t width_px = 0;
  std::uint32_t height_px = 0;
  std::string distortion_model;    ///< as ROS calls it: plumb_bob or equidistant
  std::vector<double> distortion;  ///< D: five numbers, or four
  std::array<double, 9> k{};       ///< row by row, in pixels
  std::array<double, 12> p{};      ///< row by row; of the right camera, with its place
};

/// Both cameras have the same lens, and the right one is the left one moved along x by the
/// baseline. Nothing for DSO's FOV, which has no name there, nor for a right camera of which nobody
/// knows where it is.
std::optional<CameraInfo> camera_info(const Calibration& camera, Side side);

/// What can be told of a session's cameras.
struct CalibratedCameras {
  std::optional<CameraInfo> left;
  std::optional<CameraInfo> right;
};
CalibratedCameras calibrated_cameras(const Calibration& camera);

}  // namespace orbbuf
