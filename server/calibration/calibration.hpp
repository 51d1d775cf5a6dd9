// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/error.hpp"
#include "server/calibration/pose.hpp"

namespace orbbuf {

/// How the lens bends what a pinhole would see. DSO's KannalaBrandt is its EquiDistant by another
/// name: the same formula, the same four numbers.
enum class LensModel : std::uint8_t {
  kPinhole,      ///< no distortion
  kRadTan,       ///< k1 k2 p1 p2, as OpenCV has them
  kFov,          ///< omega, in rad
  kEquidistant,  ///< k1 k2 k3 k4, as OpenCV's fisheye has them
};

/// A lens and the images behind it.
struct Camera {
  LensModel model = LensModel::kPinhole;
  std::string name;  ///< of the model, as DSO calls it
  double fx_px = 0;
  double fy_px = 0;
  double cx_px = 0;  ///< the middle of the first pixel is 0
  double cy_px = 0;
  std::vector<double> distortion;
  int width_px = 0;
  int height_px = 0;

  friend bool operator==(const Camera&, const Camera&) = default;
};

/// What an imu.yaml of Kalibr says of a sensor; 0: nothing.
struct ImuNoise {
  std::string name;  ///< `imu0`
  double rate_hz = 0;
  double gyroscope_noise_density = 0;      ///< rad/s/sqrt(Hz)
  double gyroscope_random_walk = 0;        ///< rad/s^2/sqrt(Hz)
  double accelerometer_noise_density = 0;  ///< m/s^2/sqrt(Hz)
  double accelerometer_random_walk = 0;    ///< m/s^3/sqrt(Hz)
};

/// The cameras and inertial sensors of a robot.
struct Calibration {
  Camera left;  ///< or the only one
  std::optional<Camera> right;
  Pose right_from_left;               ///< if there is a right one
  std::optional<Pose> left_from_imu;  ///< Kalibr's T_cam_imu of cam0
  /// Kalibr's: a time of the sensor is one of the camera and this. Nothing here applies it.
  std::optional<double> time_shift_s;
  std::vector<ImuNoise> imus;

  /// Of a rectified pair: the right camera has the lens of the left one, and is that far along x.
  /// Otherwise 0.
  double baseline_m() const;
};

/// In a session's folder.
inline constexpr const char* kCameraFile = "camera.txt";
inline constexpr const char* kKalibrFile = "camchain-imucam.yaml";

/// Reads DSO's four lines: the model's name (or none, as DSO's older files) and its numbers, in
/// pixels or, as DSO decides it, relative to the size; the images' size; `crop`, `full`, `none` or
/// five numbers; the size that DSO makes of them. A fifth line is the baseline in metres, as Stereo
/// DSO has it. The error names the line.
Result<Calibration> parse_camera_txt(std::string_view text);

/// Of either form: is_kalibr() tells which. The error names the file in the session's folder.
Result<Calibration> parse_calibration(std::string_view text);

/// The four lines of the left camera, and the baseline of a rectified pair.
std::string to_camera_txt(const Calibration& calibration);

/// A file for people and programs: its name and its text.
struct CalibrationFile {
  std::string name;
  std::string text;
};
/// camera.txt as it was sent; or Kalibr's file as it was sent, and a camera.txt that is made of it,
/// if it can be read. Empty of an empty text.
std::vector<CalibrationFile> calibration_files(std::string_view text);

}  // namespace orbbuf
