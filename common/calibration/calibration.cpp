// SPDX-License-Identifier: Apache-2.0
#include "common/calibration/calibration.hpp"

#include <fmt/core.h>
#include <fmt/format.h>

#include <span>

#include "common/calibration/kalibr.hpp"
#include "common/decimal.hpp"
#include "common/text_lines.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kIntrinsics = 4;

struct Model {
  std::string_view name;
  LensModel model;
  std::size_t numbers;  // fx fy cx cy, and the lens's
};

constexpr std::array<Model, 5> kModels = {{{"Pinhole", LensModel::kPinhole, 5},
                                           {"RadTan", LensModel::kRadTan, 8},
                                           {"FOV", LensModel::kFov, 5},
                                           {"EquiDistant", LensModel::kEquidistant, 8},
                                           {"KannalaBrandt", LensModel::kEquidistant, 8}}};
constexpr const Model& kPinhole = kModels[0];
constexpr const Model& kRadTan = kModels[1];
constexpr const Model& kFov = kModels[2];

using Words = std::vector<std::string_view>;

std::vector<Words> lines_of(std::string_view text) {
  std::vector<Words> lines;
  while (!text.empty()) lines.push_back(words_of(take_line(text)));
  return lines;
}

/// All of `words`, if each is a number.
template <class Number>
std::optional<std::vector<Number>> numbers_of(std::span<const std::string_view> words) {
  std::vector<Number> numbers(words.size());
  for (std::size_t i = 0; i < words.size(); ++i) {
    const auto number = parse_number<Number>(words[i]);
    if (!number || !std::isfinite(*number)) return std::nullopt;
    numbers[i] = *number;
  }
  return numbers;
}

/// Without a name the count of the numbers tells, and for five of them the fifth.
const Model* model_without_name(std::span<const double> numbers) {
  if (numbers.size() == kRadTan.numbers) return &kRadTan;
  if (numbers.size() != kFov.numbers) return nullptr;
  return numbers.back() == 0 ? &kPinhole : &kFov;
}

std::optional<Camera> parse_model(const Words& words) {
  std::span<const std::string_view> rest(words);
  const Model* model = nullptr;
  for (const Model& known : kModels) {
    if (!words.empty() && words[0] == known.name) model = &known;
  }
  if (model) rest = rest.subspan(1);
  const auto numbers = numbers_of<double>(rest);
  if (!numbers) return std::nullopt;
  if (!model) model = model_without_name(*numbers);
  if (!model || numbers->size() != model->numbers) return std::nullopt;
  const auto& n = *numbers;
  if (n[0] <= 0 || n[1] <= 0) return std::nullopt;
  Camera camera{model->model, std::string(model->name), n[0], n[1], n[2], n[3], {}};
  if (model->model != LensModel::kPinhole) {
    camera.distortion.assign(n.begin() + kIntrinsics, n.end());
  }
  return camera;
}

/// DSO's rule, and its half a pixel: relative numbers count from the image's edge.
void make_absolute(Camera& camera) {
  if (camera.cx_px >= 1 || camera.cy_px >= 1) return;
  constexpr double kHalfPixel = 0.5;
  camera.fx_px *= camera.width_px;
  camera.fy_px *= camera.height_px;
  camera.cx_px = camera.cx_px * camera.width_px - kHalfPixel;
  camera.cy_px = camera.cy_px * camera.height_px - kHalfPixel;
}

std::optional<std::vector<int>> parse_size(const Words& words) {
  auto size = numbers_of<int>(words);
  if (!size || size->size() != 2 || size->at(0) <= 0 || size->at(1) <= 0) return std::nullopt;
  return size;
}

bool is_rectification(const Words& words) {
  constexpr std::size_t kNumbers = 5;
  if (words.size() == kNumbers) return numbers_of<double>(words).has_value();
  return words.size() == 1 && (words[0] == "crop" || words[0] == "full" || words[0] == "none");
}

}  // namespace

double Calibration::baseline_m() const {
  const auto& [x, y, z] = right_from_left.translation_m;
  const bool is_rectified =
      right == left && right_from_left.rotation == kIdentity && x < 0 && y == 0 && z == 0;
  return is_rectified ? -x : 0;
}

Result<Calibration> parse_camera_txt(std::string_view text) {
  constexpr std::size_t kLines = 4;
  auto lines = lines_of(text);
  if (lines.size() < kLines) {
    return Error{fmt::format("{} lines; expected DSO's four", lines.size())};
  }
  auto camera = parse_model(lines[0]);
  if (!camera) {
    return Error{
        "line 1: expected Pinhole or FOV and 5 numbers, or RadTan, EquiDistant or "
        "KannalaBrandt and 8"};
  }
  const auto size = parse_size(lines[1]);
  if (!size) return Error{"line 2: expected WIDTH HEIGHT"};
  camera->width_px = size->at(0);
  camera->height_px = size->at(1);
  make_absolute(*camera);
  if (!is_rectification(lines[2])) {
    return Error{"line 3: expected crop, full, none or five numbers"};
  }
  if (!parse_size(lines[3])) return Error{"line 4: expected WIDTH HEIGHT"};
  Calibration calibration;
  calibration.left = std::move(*camera);
  if (lines.size() > kLines && lines[4].size() == 1) {
    const auto baseline = numbers_of<double>(lines[4]);
    if (!baseline || baseline->front() <= 0) {
      return Error{"line 5: expected the baseline in metres"};
    }
    calibration.right = calibration.left;
    calibration.right_from_left.translation_m[0] = -baseline->front();
  }
  return calibration;
}

bool is_kalibr(std::string_view calibration) {
  return calibration.find(':') != calibration.npos && !parse_camera_txt(calibration);
}

Result<Calibration> parse_any_calibration(std::string_view text) {
  return is_kalibr(text) ? parse_kalibr(text) : parse_camera_txt(text);
}

Result<Calibration> parse_calibration(std::string_view text) {
  auto calibration = parse_any_calibration(text);
  if (calibration && calibration.value().unread.empty()) return calibration;
  return Error{fmt::format("{}: {}", is_kalibr(text) ? kKalibrFile : kCameraFile,
                           calibration ? calibration.value().unread : calibration.error().text)};
}

std::string size_problem(std::string_view calibration, int width_px, int height_px) {
  const auto read = parse_any_calibration(calibration);
  if (!read) return {};
  const Camera& camera = read.value().left;
  const bool is_known = width_px > 0 && height_px > 0;
  if (!is_known || (camera.width_px == width_px && camera.height_px == height_px)) return {};
  return fmt::format("the calibration is of images of {}x{} pixels, and the frames have {}x{}",
                     camera.width_px, camera.height_px, width_px, height_px);
}

std::string to_camera_txt(const Calibration& calibration) {
  const Camera& camera = calibration.left;
  std::vector<double> lens = camera.distortion;
  if (lens.empty()) lens = {0};
  std::string text = fmt::format("{0} {1} {2} {3} {4} {5}\n{6} {7}\ncrop\n{6} {7}\n", camera.name,
                                 camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px,
                                 fmt::join(lens, " "), camera.width_px, camera.height_px);
  if (calibration.baseline_m() > 0) text += fmt::format("{}\n", calibration.baseline_m());
  return text;
}

std::vector<CalibrationFile> calibration_files(std::string_view text) {
  std::vector<CalibrationFile> files;
  if (text.empty()) return files;
  if (!is_kalibr(text)) return {{kCameraFile, std::string(text)}};
  if (const auto read = parse_calibration(text))
    files.push_back({kCameraFile, to_camera_txt(read.value())});
  files.push_back({kKalibrFile, std::string(text)});
  return files;
}

}  // namespace orbbuf
