// SPDX-License-Identifier: Apache-2.0
#include "common/calibration/kalibr.hpp"

#include <fmt/core.h>
#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <limits>
#include <vector>

#include "common/decimal.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kLensNumbers = 4;
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

/// Thrown by what reads a value, caught by result_of().
struct Bad {
  std::string why;
};

/// What `read` returns, or why it cannot.
template <class Read>
auto result_of(const Read& read) -> Result<decltype(read())> {
  try {
    return read();
  } catch (const Bad& bad) {
    return Error{bad.why};
  } catch (const YAML::Exception& error) {
    return Error{error.what()};
  }
}

std::vector<double> numbers_of(const YAML::Node& node, const std::string& key, std::size_t count) {
  std::vector<double> numbers;
  if (node && node.IsSequence()) {
    for (const auto& each : node) numbers.push_back(each.as<double>(kNone));
  }
  bool is_good = numbers.size() == count;
  for (const double number : numbers) is_good = is_good && std::isfinite(number);
  if (!is_good) throw Bad{fmt::format("{}: expected {} numbers", key, count)};
  return numbers;
}

double number_of(const YAML::Node& node, const std::string& key) {
  const auto number = node.as<double>(kNone);
  if (!std::isfinite(number)) throw Bad{key + ": expected a number"};
  return number;
}

/// A matrix of four rows.
Pose pose_of(const YAML::Node& node, const std::string& key) {
  constexpr std::size_t kRows = 3;
  if (!node.IsSequence() || node.size() != kRows + 1) throw Bad{key + ": expected four rows"};
  Pose pose;
  for (std::size_t i = 0; i < kRows; ++i) {
    const auto numbers = numbers_of(node[i], fmt::format("{}, row {}", key, i + 1), kRows + 1);
    for (std::size_t j = 0; j < kRows; ++j) pose.rotation.at(kRows * i + j) = numbers[j];
    pose.translation_m.at(i) = numbers[kRows];
  }
  // Kalibr writes some 16 digits; people may keep fewer.
  constexpr double kClose = 1e-3;
  const Matrix3 square = pose.rotation * transposed(pose.rotation);
  for (std::size_t i = 0; i < square.size(); ++i) {
    if (std::abs(square.at(i) - kIdentity.at(i)) > kClose) throw Bad{key + ": not a rotation"};
  }
  return pose;
}

struct Lens {
  std::string_view kalibr;
  LensModel model;
  const char* dso;
  std::size_t numbers;
};
constexpr std::array<Lens, 4> kLenses = {
    {{"none", LensModel::kPinhole, "Pinhole", 0},
     {"radtan", LensModel::kRadTan, "RadTan", 4},
     {"equidistant", LensModel::kEquidistant, "EquiDistant", 4},
     {"fov", LensModel::kFov, "FOV", 1}}};

/// A model that nothing here reads is set in `unread`; then the camera has nothing but its size.
Camera camera_of(const YAML::Node& node, const std::string& name, std::string& unread) {
  Camera camera;
  const std::string key = name + ".resolution";
  const auto size = numbers_of(node["resolution"], key, 2);
  for (const double pixels : size) {
    constexpr double kMost = 1 << 16;
    if (pixels < 1 || pixels > kMost) throw Bad{key + ": expected a width and a height"};
  }
  camera.width_px = static_cast<int>(size[0]);
  camera.height_px = static_cast<int>(size[1]);
  if (!node["camera_model"]) throw Bad{name + ".camera_model: missing"};
  const auto model = node["camera_model"].as<std::string>();
  const auto distortion = node["distortion_model"].as<std::string>("none");
  const auto* const lens = std::ranges::find(kLenses, distortion, &Lens::kalibr);
  if (model != "pinhole") {
    unread = fmt::format("{}.camera_model: {}; expected pinhole", name, model);
  } else if (lens == kLenses.end()) {
    unread = fmt::format("{}.distortion_model: {}; expected radtan, equidistant, fov or none", name,
                         distortion);
  }
  if (!unread.empty()) return camera;
  const auto f = numbers_of(node["intrinsics"], name + ".intrinsics", kLensNumbers);
  if (f[0] <= 0 || f[1] <= 0) throw Bad{name + ".intrinsics: expected a focal length above 0"};
  camera.model = lens->model;
  camera.name = lens->dso;
  camera.fx_px = f[0];
  camera.fy_px = f[1];
  camera.cx_px = f[2];
  camera.cy_px = f[3];
  if (lens->numbers > 0) {
    camera.distortion =
        numbers_of(node["distortion_coeffs"], name + ".distortion_coeffs", lens->numbers);
  }
  return camera;
}

/// Kalibr writes T_cam_imu, OpenVINS T_imu_cam.
std::optional<Pose> camera_from_imu(const YAML::Node& camera, const std::string& name) {
  if (camera["T_cam_imu"]) return pose_of(camera["T_cam_imu"], name + ".T_cam_imu");
  if (camera["T_imu_cam"]) return pose_of(camera["T_imu_cam"], name + ".T_imu_cam").inverse();
  return std::nullopt;
}

Pose right_from_left(const YAML::Node& right, const std::optional<Pose>& left_from_imu) {
  Pose pose;
  if (right["T_cn_cnm1"]) {
    pose = pose_of(right["T_cn_cnm1"], "cam1.T_cn_cnm1");
  } else if (const auto right_from_imu = camera_from_imu(right, "cam1");
             right_from_imu && left_from_imu) {
    pose = *right_from_imu * left_from_imu->inverse();
  } else {
    throw Bad{"cam1.T_cn_cnm1: missing; T_cam_imu or T_imu_cam of both cameras would do"};
  }
  return pose;
}

/// A VIO divides by each of them.
ImuNoise noise_of(const YAML::Node& node, const std::string& name) {
  const auto noise = [&](const char* key) {
    const double number = node[key] ? number_of(node[key], name + '.' + key) : 0;
    if (number <= 0) throw Bad{fmt::format("{}.{}: expected a number above 0", name, key)};
    return number;
  };
  return {name,
          node["update_rate"] ? number_of(node["update_rate"], name + ".update_rate") : 0,
          noise("gyroscope_noise_density"),
          noise("gyroscope_random_walk"),
          noise("accelerometer_noise_density"),
          noise("accelerometer_random_walk")};
}

Calibration calibration_of(const YAML::Node& chain) {
  Calibration calibration;
  if (!chain.IsMap() || !chain["cam0"]) throw Bad{"cam0: missing"};
  const YAML::Node left = chain["cam0"];
  calibration.left = camera_of(left, "cam0", calibration.unread);
  calibration.left_from_imu = camera_from_imu(left, "cam0");
  if (left["timeshift_cam_imu"]) {
    calibration.time_shift_s = number_of(left["timeshift_cam_imu"], "cam0.timeshift_cam_imu");
  }
  if (const YAML::Node right = chain["cam1"]) {
    calibration.right = camera_of(right, "cam1", calibration.unread);
    calibration.right_from_left = right_from_left(right, calibration.left_from_imu);
    if (length(calibration.right_from_left.translation_m) == 0) {
      calibration.right.reset();
      calibration.right_from_left = {};
      calibration.remarks.emplace_back("cam1 is not used: both cameras are in one place");
    }
  }
  for (const auto& entry : chain) {
    const auto name = entry.first.as<std::string>();
    if (name.starts_with("imu")) calibration.imus.push_back(noise_of(entry.second, name));
  }
  if (!calibration.imus.empty() && !calibration.left_from_imu) {
    calibration.remarks.emplace_back(
        "cam0 has neither T_cam_imu nor T_imu_cam: where the inertial sensor is, is not known");
  }
  return calibration;
}

/// Of a file with the noise of one sensor, with or without a name above it.
YAML::Node sensor_of(const std::string& name, std::string_view imu_yaml) {
  const YAML::Node file = YAML::Load(std::string(imu_yaml));
  if (!file.IsMap()) throw Bad{"expected keys such as gyroscope_noise_density"};
  std::vector<YAML::Node> named;
  for (const auto& entry : file) {
    const auto key = entry.first.as<std::string>();
    if (!key.starts_with("imu")) continue;
    if (key == name) return entry.second;
    named.push_back(entry.second);
  }
  if (named.size() > 1) throw Bad{"several sensors, none of which is " + name};
  return named.empty() ? file : named[0];
}

/// A number or a word as it is, all else in quotes.
std::string scalar(const YAML::Node& node) {
  std::string text = node.Scalar();
  if (text.starts_with('+')) text.erase(0, 1);
  const auto number = parse_number<double>(text);
  const bool is_word = !text.empty() &&
                       (std::isalpha(static_cast<unsigned char>(text[0])) || text[0] == '/') &&
                       std::ranges::all_of(text, [](unsigned char c) {
                         return std::isalnum(c) || c == '_' || c == '/' || c == '.' || c == '-';
                       });
  if (is_word || (number && std::isfinite(*number))) return text;
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') quoted += '\\';
    if (c == '\n') {
      quoted += "\\n";
    } else {
      quoted += c;
    }
  }
  return quoted + '"';
}

/// In a line. Throws for an alias to what it is in, by its depth.
std::string in_line(const YAML::Node& node, int depth = 0) {
  constexpr int kMostDepth = 8;
  if (depth > kMostDepth) throw Bad{"more than 8 levels of lists and keys"};
  std::vector<std::string> parts;
  if (node.IsNull()) return "~";
  if (node.IsScalar()) return scalar(node);
  if (node.IsSequence()) {
    for (const auto& each : node) parts.push_back(in_line(each, depth + 1));
    return fmt::format("[{}]", fmt::join(parts, ", "));
  }
  for (const auto& entry : node) {
    parts.push_back(scalar(entry.first) + ": " + in_line(entry.second, depth + 1));
  }
  return fmt::format("{{{}}}", fmt::join(parts, ", "));
}

/// A line for each key of each sensor and each row of a matrix. The first line is YAML's own form
/// of OpenCV's `%YAML:1.0`: OpenCV takes both, Kalibr's YAML parser only this one.
std::string to_text(const YAML::Node& chain) {
  std::string text = "%YAML 1.0\n---\n";
  for (const auto& sensor : chain) {
    if (!sensor.second.IsMap() || sensor.second.size() == 0) {
      text += fmt::format("{}: {}\n", scalar(sensor.first), in_line(sensor.second));
      continue;
    }
    text += scalar(sensor.first) + ":\n";
    for (const auto& entry : sensor.second) {
      const YAML::Node& value = entry.second;
      text += fmt::format("  {}:", scalar(entry.first));
      if (value.IsSequence() && value.size() > 0 && value[0].IsSequence()) {
        for (const auto& row : value) text += "\n    - " + in_line(row);
      } else {
        text += ' ' + in_line(value);
      }
      text += '\n';
    }
  }
  return text;
}

}  // namespace

Result<Calibration> parse_kalibr(std::string_view text) {
  return result_of([&] { return calibration_of(YAML::Load(std::string(text))); });
}

Result<std::string> rewrite_kalibr(std::string_view chain) {
  return result_of([&] { return to_text(YAML::Load(std::string(chain))); });
}

Result<std::string> add_imu(std::string_view chain, const std::string& name,
                            std::string_view imu_yaml) {
  return result_of([&] {
    YAML::Node joined = YAML::Load(std::string(chain));
    joined[name] = sensor_of(name, imu_yaml);
    return to_text(joined);
  });
}

}  // namespace orbbuf
