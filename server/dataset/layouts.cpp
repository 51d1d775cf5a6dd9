// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/layouts.hpp"

#include <fmt/core.h>
#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <utility>

#include "common/calibration/calibration.hpp"
#include "common/decimal.hpp"
#include "server/session/session_lines.hpp"
#include "server/session/session_names.hpp"

namespace orbbuf {
namespace {

/// Nothing, and a note, if there is none that can be read.
std::optional<Calibration> calibration_of(const RecordedSession& session, Dataset& dataset) {
  if (session.summary.info.calibration.empty()) return std::nullopt;
  auto calibration = parse_calibration(session.summary.info.calibration);
  if (calibration) return std::move(calibration).value();
  dataset.notes.push_back("no calibration: " + calibration.error().text);
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

/// The first lines of a sensor.yaml. imu_from_sensor: T_BS, where the body is the inertial sensor,
/// or the left camera if it is not known where that is.
std::string sensor_yaml(std::string_view type, const Pose& imu_from_sensor, double rate_hz) {
  std::string yaml = fmt::format(
      "sensor_type: {}\ncomment: by orbbuf-server export\nT_BS:\n  cols: 4\n  rows: 4\n  data: [",
      type);
  for (std::size_t i = 0; i < 3; ++i) {
    yaml += fmt::format("{:#}, {:#},\n         ", fmt::join(row(imu_from_sensor.rotation, i), ", "),
                        imu_from_sensor.translation_m.at(i));
  }
  yaml += "0.0, 0.0, 0.0, 1.0]\n";
  if (rate_hz > 0) yaml += fmt::format("rate_hz: {:.3f}\n", rate_hz);
  return yaml;
}

std::string camera_yaml(const Camera& camera, double rate_hz, const Pose& imu_from_camera) {
  std::vector<double> distortion = camera.distortion;
  if (camera.model == LensModel::kPinhole) distortion = {0, 0, 0, 0};
  return sensor_yaml("camera", imu_from_camera, rate_hz) +
         fmt::format(
             "resolution: [{}, {}]\n"
             "camera_model: pinhole\n"
             "intrinsics: [{}, {}, {}, {}]\n"
             "distortion_model: {}\n"
             "distortion_coefficients: [{}]\n",
             camera.width_px, camera.height_px, camera.fx_px, camera.fy_px, camera.cx_px,
             camera.cy_px, euroc_name(camera.model), fmt::join(distortion, ", "));
}

std::string imu_yaml(const ImuNoise& imu) {
  return sensor_yaml("imu", {}, imu.rate_hz) +
         fmt::format(
             "gyroscope_noise_density: {}\n"
             "gyroscope_random_walk: {}\n"
             "accelerometer_noise_density: {}\n"
             "accelerometer_random_walk: {}\n",
             imu.gyroscope_noise_density, imu.gyroscope_random_walk,
             imu.accelerometer_noise_density, imu.accelerometer_random_walk);
}

/// A row-major 3x4 matrix: the camera at `x_m` to the right.
std::string projection(const Camera& camera, double x_m) {
  return fmt::format("{:.12e} 0 {:.12e} {:.12e} 0 {:.12e} {:.12e} 0 0 0 1 0", camera.fx_px,
                     camera.cx_px, x_m == 0 ? 0 : -camera.fx_px * x_m, camera.fy_px, camera.cy_px);
}

/// What all layouts need; each fills in `made`.
struct Work {
  const RecordedSession& session;
  std::string_view extension;
  Dataset made;
  int digits = 6;  ///< of images that are named by their numbers, so that their names sort

  void note(std::string text) { made.notes.push_back(std::move(text)); }
  void text(std::string to, std::string content) {
    made.texts.push_back({std::move(to), std::move(content)});
  }
  /// Without a folder `right` the right image is left out.
  void images(const RecordedFrame& frame, const char* left, const char* right,
              const std::string& stem) {
    const auto add = [&](std::string from, const char* folder) {
      made.images.push_back({std::move(from), fmt::format("{}/{}.{}", folder, stem, extension)});
    };
    add(session_names::left_image(frame.sequence), left);
    if (right != nullptr && frame.is_stereo()) {
      add(session_names::right_image(frame.sequence), right);
    }
  }
  const std::string& calibration() const { return session.summary.info.calibration; }
};

void lay_out_tum_mono(Work& work) {
  std::string times;
  std::string checksums;
  std::string qualities;
  for (const RecordedFrame& frame : work.session.frames) {
    const std::string stem = fmt::format("{:0{}}", frame.sequence, work.digits);
    const std::size_t first = work.made.images.size();
    work.images(frame, session_names::kImages, session_names::kRightImages, stem);
    for (std::size_t i = first; i < work.made.images.size(); ++i) {
      checksums += fmt::format("{} {:08X}\n", work.made.images[i].to,
                               i == first ? frame.crc : frame.crc_right);
    }
    times += session_lines::times(frame);
    qualities += session_lines::quality(frame);
  }
  std::string drops;
  for (const DropRecord& drop : work.session.drops) drops += to_csv(drop);
  if (!drops.empty())
    work.text(session_names::kDrops, fmt::format("{}\n{}", kDropCsvHeader, drops));
  if (!checksums.empty()) work.text(session_names::kChecksums, std::move(checksums));
  if (!qualities.empty()) {
    work.text(session_names::kQualities, std::string(session_lines::kQualityHeader) + qualities);
  }
  for (CalibrationFile& file : calibration_files(work.calibration())) {
    work.text(std::move(file.name), std::move(file.text));
  }
  work.text(session_names::kTimes, std::move(times));
}

void lay_out_euroc(Work& work) {
  std::string index = "#timestamp [ns],filename\n";
  for (const RecordedFrame& frame : work.session.frames) {
    // As today's times are: names of one length sort as times, and are what loaders make of the
    // first column.
    const std::string stem = fmt::format("{:019}", frame.capture_time_ns);
    work.images(frame, "mav0/cam0/data", "mav0/cam1/data", stem);
    index += fmt::format("{0},{0}.{1}\n", stem, work.extension);
  }
  work.text("mav0/cam0/data.csv", index);
  if (is_stereo(work.session)) work.text("mav0/cam1/data.csv", std::move(index));
  add_euroc_calibration(work.session, work.made);
}

void lay_out_kitti(Work& work) {
  std::string times;
  std::size_t number = 0;
  for (const RecordedFrame& frame : work.session.frames) {
    const std::string stem = fmt::format("{:0{}}", number++, work.digits);
    work.images(frame, "image_0", "image_1", stem);
    times += format_seconds(frame.capture_time_ns) + '\n';
  }
  work.text("times.txt", std::move(times));
  add_kitti_camera(work.session, work.made);
}

void lay_out_tum_rgbd(Work& work) {
  std::string index = "# color images\n# by orbbuf-server export\n# timestamp filename\n";
  for (const RecordedFrame& frame : work.session.frames) {
    const std::string stem = format_seconds(frame.capture_time_ns);
    work.images(frame, "rgb", nullptr, stem);
    index += fmt::format("{} {}\n", stem, work.made.images.back().to);
  }
  work.text("rgb.txt", std::move(index));
  if (is_stereo(work.session)) work.note("TUM RGB-D has one camera: the right images are left out");
  if (work.calibration().empty()) return;
  work.note("TUM RGB-D has no file for a calibration: it is left out");
}

}  // namespace

bool is_stereo(const RecordedSession& session) {
  return std::ranges::any_of(session.frames, &RecordedFrame::is_stereo);
}

void add_euroc_calibration(const RecordedSession& session, Dataset& dataset) {
  const auto calibration = calibration_of(session, dataset);
  if (!calibration) return;
  const double rate_hz = frames_per_second(session);
  const Pose imu_from_left = calibration->left_from_imu.value_or(Pose{}).inverse();
  const auto add = [&](const std::string& sensor, std::string text) {
    dataset.texts.push_back({"mav0/" + sensor + "/sensor.yaml", std::move(text)});
  };
  for (const std::string& remark : calibration->remarks) {
    dataset.notes.push_back("calibration: " + remark);
  }
  for (const ImuNoise& imu : calibration->imus) add(imu.name, imu_yaml(imu));
  add("cam0", camera_yaml(calibration->left, rate_hz, imu_from_left));
  if (!is_stereo(session)) return;
  if (!calibration->right) {
    dataset.notes.emplace_back("no cam1/sensor.yaml: the calibration has no right camera");
    return;
  }
  add("cam1", camera_yaml(*calibration->right, rate_hz,
                          imu_from_left * calibration->right_from_left.inverse()));
}

void add_kitti_camera(const RecordedSession& session, Dataset& dataset) {
  const auto calibration = calibration_of(session, dataset);
  if (!calibration) return;
  const Camera& camera = calibration->left;
  const double baseline_m = calibration->baseline_m();
  if (camera.model != LensModel::kPinhole) {
    dataset.notes.push_back("no calib.txt: KITTI's knows no lens distortion, and the camera is " +
                            camera.name);
    return;
  }
  std::string calib = "P0: " + projection(camera, 0) + '\n';
  if (is_stereo(session) && baseline_m == 0) {
    dataset.notes.emplace_back("no P1 in calib.txt: the calibration is of no rectified pair");
  } else if (is_stereo(session)) {
    calib += "P1: " + projection(camera, baseline_m) + '\n';
  }
  dataset.texts.push_back({"calib.txt", std::move(calib)});
}

Dataset lay_out(const RecordedSession& session, Layout layout, std::string_view extension) {
  Work work{session, extension, {}};
  constexpr Sequence kMostOfSixDigits = 999'999;
  if (!session.frames.empty() && session.frames.back().sequence > kMostOfSixDigits) work.digits = 9;
  if (work.calibration().empty()) work.note("no calibration: the robot sent none");
  switch (layout) {
    case Layout::kTumMono:
      lay_out_tum_mono(work);
      break;
    case Layout::kEuroc:
      lay_out_euroc(work);
      break;
    case Layout::kKitti:
      lay_out_kitti(work);
      break;
    case Layout::kTumRgbd:
      lay_out_tum_rgbd(work);
      break;
    case Layout::kMcap:
      break;
  }
  if (layout != Layout::kTumMono && is_kalibr(work.calibration())) {
    work.text(kKalibrFile, work.calibration());
  }
  return std::move(work.made);
}

}  // namespace orbbuf
