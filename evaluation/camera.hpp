// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

#include "common/calibration/calibration.hpp"

namespace orbbuf::evaluation {

/// A pinhole camera, or two of them side by side.
struct Camera {
  double fx = 0;  ///< pixels, as the next three
  double fy = 0;
  double cx = 0;
  double cy = 0;
  int width_px = 0;
  int height_px = 0;
  double baseline_m = 0;  ///< from the left to the right one; 0: mono

  bool is_stereo() const { return baseline_m > 0; }
};

/// DSO's camera.txt, which a robot sends along and the server writes: four lines and, if stereo, a
/// fifth with the baseline in metres, as Stereo DSO has it.
std::string to_text(const Camera& camera);

/// Reads any camera.txt that DSO accepts. Throws std::runtime_error, naming the file and the line
/// that is wrong.
Calibration read_calibration(const std::filesystem::path& file);

/// The same for the reference VO, which takes images as they are: whatever lines 3 and 4 say, which
/// describe DSO's output. Throws std::runtime_error also if the lens distorts.
Camera read_camera(const std::filesystem::path& file);

}  // namespace orbbuf::evaluation
