// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/error.hpp"

namespace orbbuf {

/// How the lens bends what a pinhole would see. DSO's KannalaBrandt is its EquiDistant by another
/// name: the same formula, the same four numbers.
enum class LensModel : std::uint8_t {
  kPinhole,      ///< no distortion
  kRadTan,       ///< k1 k2 p1 p2, as OpenCV has them
  kFov,          ///< omega, in rad
  kEquidistant,  ///< k1 k2 k3 k4, as OpenCV's fisheye has them
};

/// A camera as camera.txt describes it.
struct Calibration {
  LensModel model = LensModel::kPinhole;
  std::string name;  ///< of the model, as DSO calls it
  double fx_px = 0;
  double fy_px = 0;
  double cx_px = 0;  ///< the middle of the first pixel is 0
  double cy_px = 0;
  std::vector<double> distortion;
  int width_px = 0;
  int height_px = 0;
  double baseline_m = 0;  ///< from the left camera to the right one; 0: unknown
};

/// Reads DSO's four lines: the model's name (or none, as DSO's older files) and its numbers, in
/// pixels or, as DSO decides it, relative to the size; the images' size; `crop`, `full`, `none` or
/// five numbers; the size that DSO makes of them. A fifth line is the baseline in metres, as Stereo
/// DSO has it. The error names the line.
Result<Calibration> parse_calibration(std::string_view camera_txt);

}  // namespace orbbuf
