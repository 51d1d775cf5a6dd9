// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/error.hpp"

namespace orbbuf {

using Vector3 = std::array<double, 3>;
/// Row by row.
using Matrix3 = std::array<double, 9>;

inline constexpr Matrix3 kIdentity{1, 0, 0, 0, 1, 0, 0, 0, 1};

inline Vector3 row(const Matrix3& matrix, std::size_t i) {
  return {matrix[3 * i], matrix[3 * i + 1], matrix[3 * i + 2]};
}
inline double dot(const Vector3& a, const Vector3& b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
inline Vector3 cross(const Vector3& a, const Vector3& b) {
  return {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]};
}
inline Vector3 scaled(const Vector3& a, double factor) {
  return {a[0] * factor, a[1] * factor, a[2] * factor};
}
inline double length(const Vector3& a) { return std::sqrt(dot(a, a)); }
inline Matrix3 transposed(const Matrix3& m) {
  return {m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]};
}
inline Vector3 operator*(const Matrix3& m, const Vector3& v) {
  return {dot(row(m, 0), v), dot(row(m, 1), v), dot(row(m, 2), v)};
}
inline Matrix3 operator*(const Matrix3& a, const Matrix3& b) {
  const Matrix3 columns = transposed(b);
  Matrix3 product{};
  for (std::size_t i = 0; i < product.size(); ++i) {
    product[i] = dot(row(a, i / 3), row(columns, i % 3));
  }
  return product;
}

/// Takes a point of frame b to frame a: `a_from_b`.
struct Pose {
  Matrix3 rotation = kIdentity;
  Vector3 translation_m{};

  /// Of a rotation; of another matrix it is no inverse.
  Pose inverse() const {
    const Matrix3 back = transposed(rotation);
    return {back, scaled(back * translation_m, -1)};
  }
  friend Pose operator*(const Pose& a, const Pose& b) {
    const Vector3 moved = a.rotation * b.translation_m;
    return {a.rotation * b.rotation,
            {moved[0] + a.translation_m[0], moved[1] + a.translation_m[1],
             moved[2] + a.translation_m[2]}};
  }
};

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

/// What an imu.yaml of Kalibr says of a sensor.
struct ImuNoise {
  std::string name;                        ///< `imu0`
  double rate_hz = 0;                      ///< 0: unknown
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
  /// Not empty: a camera has a model that nothing here reads, by its key; of the cameras only the
  /// sizes are known then.
  std::string unread;
  std::vector<std::string> remarks;  ///< for people: what is missing, or not used, and why

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

/// Whether it is to be read as Kalibr's YAML: it has a colon, and is not DSO's camera.txt.
bool is_kalibr(std::string_view calibration);

/// Of either form. A model that nothing here reads is set in Calibration::unread.
Result<Calibration> parse_any_calibration(std::string_view text);
/// The same, but such a model is an error. The error names the file in the session's folder.
Result<Calibration> parse_calibration(std::string_view text);

/// For people, of the first frame of a session: that it has another size than the images that the
/// calibration is of. Empty if it has not, its size is not known (0), or the calibration cannot be
/// read.
std::string size_problem(std::string_view calibration, int width_px, int height_px);

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
