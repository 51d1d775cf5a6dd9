// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/camera_files.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "server/calibration/calibration.hpp"

namespace orbbuf {
namespace {

/// Nothing, and a note, if there is none that can be read.
std::optional<Calibration> camera_of(const RecordedSession& session, Dataset& dataset) {
  if (session.summary.info.calibration.empty()) return std::nullopt;
  auto camera = parse_calibration(session.summary.info.calibration);
  if (camera) return std::move(camera).value();
  dataset.notes.push_back("no calibration: camera.txt: " + camera.error().text);
  return std::nullopt;
}

/// What lies between most frames, whatever was dropped; 0: there are too few.
double frames_per_second(const RecordedSession& session) {
  std::vector<std::int64_t> steps;
  for (std::size_t i = 1; i < session.frames.size(); ++i) {
    steps.push_back(session.frames[i].capture_time_ns - session.frames[i - 1].capture_time_ns);
  }
  if (steps.empty()) return 0;
  const auto median = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), median, steps.end());
  constexpr double kNsPerSecond = 1e9;
  return kNsPerSecond / static_cast<double>(*median);
}

/// In Kalibr's words, as the data sets in this layout have them.
const char* euroc_name(LensModel model) {
  switch (model) {
    case LensModel::kFov:
      return "fov";
    case LensModel::kEquidistant:
      return "equidistant";
    default:
      return "radial-tangential";
  }
}

std::string sensor_yaml(const Calibration& camera, double rate_hz, double x_m) {
  std::vector<double> distortion = camera.distortion;
  if (camera.model == LensModel::kPinhole) distortion = {0, 0, 0, 0};
  std::string yaml = fmt::format(
      "sensor_type: camera\n"
      "comment: camera.txt ({}), by orbbuf-server export\n"
      "T_BS:\n"
      "  cols: 4\n"
      "  rows: 4\n"
      "  data: [1.0, 0.0, 0.0, {},\n"
      "         0.0, 1.0, 0.0, 0.0,\n"
      "         0.0, 0.0, 1.0, 0.0,\n"
      "         0.0, 0.0, 0.0, 1.0]\n",
      camera.name, x_m);
  if (rate_hz > 0) yaml += fmt::format("rate_hz: {:.3f}\n", rate_hz);
  return yaml + fmt::format(
                    "resolution: [{}, {}]\n"
                    "camera_model: pinhole\n"
                    "intrinsics: [{}, {}, {}, {}]\n"
                    "distortion_model: {}\n"
                    "distortion_coefficients: [{}]\n",
                    camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px,
                    camera.cy_px, euroc_name(camera.model), fmt::join(distortion, ", "));
}

/// A row-major 3x4 matrix: the camera at `x_m` to the right.
std::string projection(const Calibration& camera, double x_m) {
  return fmt::format("{:.12e} 0 {:.12e} {:.12e} 0 {:.12e} {:.12e} 0 0 0 1 0", camera.fx_px,
                     camera.cx_px, x_m == 0 ? 0 : -camera.fx_px * x_m, camera.fy_px, camera.cy_px);
}

}  // namespace

bool is_stereo(const RecordedSession& session) {
  return std::ranges::any_of(session.frames, &RecordedFrame::is_stereo);
}

void add_euroc_camera(const RecordedSession& session, Dataset& dataset) {
  const auto camera = camera_of(session, dataset);
  if (!camera) return;
  const double rate_hz = frames_per_second(session);
  dataset.texts.push_back({"mav0/cam0/sensor.yaml", sensor_yaml(*camera, rate_hz, 0)});
  if (!is_stereo(session)) return;
  if (camera->baseline_m == 0) {
    dataset.notes.emplace_back("no cam1/sensor.yaml: camera.txt has no baseline in a fifth line");
    return;
  }
  dataset.texts.push_back(
      {"mav0/cam1/sensor.yaml", sensor_yaml(*camera, rate_hz, camera->baseline_m)});
}

void add_kitti_camera(const RecordedSession& session, Dataset& dataset) {
  const auto camera = camera_of(session, dataset);
  if (!camera) return;
  if (camera->model != LensModel::kPinhole) {
    dataset.notes.push_back("no calib.txt: KITTI's knows no lens distortion, and camera.txt is " +
                            camera->name);
    return;
  }
  std::string calib = "P0: " + projection(*camera, 0) + '\n';
  if (is_stereo(session) && camera->baseline_m == 0) {
    dataset.notes.emplace_back("no P1 in calib.txt: camera.txt has no baseline in a fifth line");
  } else if (is_stereo(session)) {
    calib += "P1: " + projection(*camera, camera->baseline_m) + '\n';
  }
  dataset.texts.push_back({"calib.txt", std::move(calib)});
}

}  // namespace orbbuf
