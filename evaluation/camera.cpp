// SPDX-License-Identifier: Apache-2.0
#include "evaluation/camera.hpp"

#include <spdlog/fmt/fmt.h>

#include <fstream>
#include <stdexcept>

namespace orbbuf::evaluation {

std::string to_text(const Camera& camera) {
  auto text =
      fmt::format("Pinhole {} {} {} {} 0\n{} {}\nnone\n{} {}\n", camera.fx, camera.fy, camera.cx,
                  camera.cy, camera.width_px, camera.height_px, camera.width_px, camera.height_px);
  if (camera.is_stereo()) text += fmt::format("{}\n", camera.baseline_m);
  return text;
}

Camera read_camera(const std::filesystem::path& file) {
  std::ifstream in(file);
  Camera camera;
  std::string model;
  std::string crop;
  int width_px = 0;
  int height_px = 0;
  double distortion = 0;
  in >> model >> camera.fx >> camera.fy >> camera.cx >> camera.cy >> distortion >>
      camera.width_px >> camera.height_px >> crop >> width_px >> height_px;
  if (!in || model != "Pinhole" || distortion != 0 || crop != "none") {
    throw std::runtime_error(file.string() + ": not a pinhole camera without distortion or crop");
  }
  if (!(in >> camera.baseline_m)) camera.baseline_m = 0;
  return camera;
}

}  // namespace orbbuf::evaluation
