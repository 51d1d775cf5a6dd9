// SPDX-License-Identifier: Apache-2.0
#include "evaluation/camera.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <utility>

namespace orbbuf::evaluation {

std::string to_text(const Camera& camera) {
  auto text =
      fmt::format("Pinhole {} {} {} {} 0\n{} {}\nnone\n{} {}\n", camera.fx, camera.fy, camera.cx,
                  camera.cy, camera.width_px, camera.height_px, camera.width_px, camera.height_px);
  if (camera.is_stereo()) text += fmt::format("{}\n", camera.baseline_m);
  return text;
}

Calibration read_calibration(const std::filesystem::path& file) {
  std::ifstream in(file);
  if (!in) throw std::runtime_error("cannot read " + file.string());
  const std::string text(std::istreambuf_iterator<char>(in), {});
  auto calibration = parse_camera_txt(text);
  if (!calibration) throw std::runtime_error(file.string() + ": " + calibration.error().text);
  return std::move(calibration).value();
}

Camera read_camera(const std::filesystem::path& file) {
  const Calibration calibration = read_calibration(file);
  const orbbuf::Camera& lens = calibration.left;
  if (lens.model == LensModel::kEquidistant ||
      std::ranges::any_of(lens.distortion, [](double number) { return number != 0; })) {
    throw std::runtime_error(fmt::format(
        "{}: the lens {} distorts, and the reference VO needs Pinhole, or RadTan or FOV with "
        "distortion 0; undistort the images, or run a SLAM program that does with --slam",
        file.string(), lens.name));
  }
  return {lens.fx_px,
          lens.fy_px,
          lens.cx_px,
          lens.cy_px,
          lens.width_px,
          lens.height_px,
          calibration.baseline_m()};
}

}  // namespace orbbuf::evaluation
