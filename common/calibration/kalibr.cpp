// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>
#include <yaml-cpp/yaml.h>

#include <array>
#include <cmath>
#include <string>

#include "common/calibration/calibration.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kLensNumbers = 4;

/// Thrown by what reads a value, caught by parse_kalibr().
struct Bad {
  std::string why;
};

std::vector<double> numbers_of(const YAML::Node& node, const std::string& key, std::size_t count) {
  std::vector<double> numbers;
  if (node && node.IsSequence()) numbers = node.as<std::vector<double>>();
  bool is_good = numbers.size() == count;
  for (const double number : numbers) is_good = is_good && std::isfinite(number);
  if (!is_good) throw Bad{fmt::format("{}: expected {} numbers", key, count)};
  return numbers;
}

double number_of(const YAML::Node& node, const std::string& key, double fallback) {
  if (!node) return fallback;
  const auto number = node.as<double>();
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

Camera camera_of(const YAML::Node& node, const std::string& name) {
  if (node["camera_model"].as<std::string>("") != "pinhole") {
    throw Bad{name + ".camera_model: expected pinhole"};
  }
  const auto distortion = node["distortion_model"].as<std::string>("none");
  const Lens* lens = nullptr;
  for (const Lens& known : kLenses) {
    if (distortion == known.kalibr) lens = &known;
  }
  if (lens == nullptr) {
    throw Bad{name + ".distortion_model: expected radtan, equidistant, fov or none"};
  }
  const auto f = numbers_of(node["intrinsics"], name + ".intrinsics", kLensNumbers);
  if (f[0] <= 0 || f[1] <= 0) throw Bad{name + ".intrinsics: expected a focal length above 0"};
  Camera camera{lens->model, lens->dso, f[0], f[1], f[2], f[3], {}};
  if (lens->numbers > 0) {
    camera.distortion =
        numbers_of(node["distortion_coeffs"], name + ".distortion_coeffs", lens->numbers);
  }
  const std::string key = name + ".resolution";
  const auto size = numbers_of(node["resolution"], key, 2);
  for (const double pixels : size) {
    constexpr double kMost = 1 << 16;
    if (pixels < 1 || pixels > kMost) throw Bad{key + ": expected a width and a height"};
  }
  camera.width_px = static_cast<int>(size[0]);
  camera.height_px = static_cast<int>(size[1]);
  return camera;
}

ImuNoise noise_of(const YAML::Node& node, const std::string& name) {
  const auto number = [&](const char* key) { return number_of(node[key], name + '.' + key, 0); };
  return {name,
          number("update_rate"),
          number("gyroscope_noise_density"),
          number("gyroscope_random_walk"),
          number("accelerometer_noise_density"),
          number("accelerometer_random_walk")};
}

Calibration calibration_of(const YAML::Node& chain) {
  Calibration calibration;
  const YAML::Node left = chain["cam0"];
  calibration.left = camera_of(left, "cam0");
  if (left["T_cam_imu"]) calibration.left_from_imu = pose_of(left["T_cam_imu"], "cam0.T_cam_imu");
  if (left["timeshift_cam_imu"]) {
    calibration.time_shift_s = number_of(left["timeshift_cam_imu"], "cam0.timeshift_cam_imu", 0);
  }
  if (const YAML::Node right = chain["cam1"]) {
    calibration.right = camera_of(right, "cam1");
    if (!right["T_cn_cnm1"]) throw Bad{"cam1.T_cn_cnm1: missing"};
    calibration.right_from_left = pose_of(right["T_cn_cnm1"], "cam1.T_cn_cnm1");
    if (length(calibration.right_from_left.translation_m) == 0) {
      throw Bad{"cam1.T_cn_cnm1: the cameras are in one place"};
    }
  }
  for (const auto& entry : chain) {
    const auto name = entry.first.as<std::string>();
    if (name.starts_with("imu")) calibration.imus.push_back(noise_of(entry.second, name));
  }
  return calibration;
}

}  // namespace

Result<Calibration> parse_kalibr(std::string_view text) {
  try {
    return calibration_of(YAML::Load(std::string(text)));
  } catch (const Bad& bad) {
    return Error{bad.why};
  } catch (const YAML::Exception& error) {
    return Error{error.what()};
  }
}

}  // namespace orbbuf
