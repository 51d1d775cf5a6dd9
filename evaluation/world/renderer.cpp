// SPDX-License-Identifier: Apache-2.0
#include "evaluation/world/renderer.hpp"

#include <algorithm>
#include <cmath>
#include <random>

#include "evaluation/random.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr double kTexelsPerCell = 256;
constexpr float kGray = 112;
constexpr double kNoise = 1.5;  // gray levels
constexpr std::size_t kNoiseSize = 1U << 20U;

float offset_of(std::uint64_t section, std::uint64_t salt) {
  return static_cast<float>(hash(section + salt) % Texture::kTexels);
}

std::vector<float> draw_noise(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::vector<float> noise(kNoiseSize);
  for (float& value : noise) {  // of the sum of four, close enough to normal
    double sum = -2;
    for (int i = 0; i < 4; ++i) sum += uniform(random, 0, 1);
    value = static_cast<float>(sum * kNoise * std::sqrt(3.0));
  }
  return noise;
}

}  // namespace

Renderer::Renderer(const Style& style, const Camera& camera, std::uint64_t seed, double duration_s)
    : style_(style),
      camera_(camera),
      seed_(seed),
      duration_s_(duration_s),
      route_(style, seed, duration_s + 1),
      place_(style, route_, seed),
      texture_(seed),
      noise_(draw_noise(seed)) {}

double Renderer::gain(double t_s) const {
  const double jump_s = duration_s_ * (0.3 + 0.1 * hash_unit(seed_));
  const double jump = std::clamp((t_s - jump_s) / 0.3, 0.0, 1.0);
  return 0.9 + 0.15 * std::sin(0.35 * t_s) + 0.25 * jump - 0.1 * std::sin(0.11 * t_s);
}

double Renderer::blur_px(double t_s) const {
  const double half_s = style_.exposure_s / 2;
  const double turned = route_.at(t_s + half_s).heading - route_.at(t_s - half_s).heading;
  return std::abs(turned) * camera_.fx;
}

Rendered Renderer::render(double t_s, bool with_depth) const {
  Rendered frame;
  frame.left = view(t_s, 0, with_depth ? &frame.depth : nullptr);
  if (camera_.is_stereo()) frame.right = view(t_s, camera_.baseline_m, nullptr);
  return frame;
}

cv::Mat Renderer::view(double t_s, double right_m, cv::Mat* depth) const {
  const auto pixels =
      static_cast<std::size_t>(camera_.width_px) * static_cast<std::size_t>(camera_.height_px);
  std::vector<float> sum(pixels, 0);
  const int views = std::clamp(static_cast<int>(std::ceil(blur_px(t_s) / 1.5)), 1, 4);
  for (int i = 0; i < views; ++i) {
    const double at_s = t_s + style_.exposure_s * ((i + 0.5) / views - 0.5);
    CameraPose pose = route_.at(at_s);
    pose.x += right_m * std::sin(pose.heading);
    pose.y -= right_m * std::cos(pose.heading);
    add_view(pose, sum, nullptr);
  }
  if (depth) {
    std::vector<float> unused(pixels, 0);
    add_view(route_.at(t_s), unused, depth);
  }
  const float scale = static_cast<float>(gain(t_s)) / static_cast<float>(views);
  const auto shift = static_cast<std::size_t>(
      hash(seed_ + static_cast<std::uint64_t>(std::llround(t_s * 1e6)) + (right_m > 0)));
  cv::Mat image(camera_.height_px, camera_.width_px, CV_8U);
  for (std::size_t i = 0; i < pixels; ++i) {
    const float value = sum[i] * scale + noise_[(i + shift) % kNoiseSize];
    image.data[i] = static_cast<std::uint8_t>(std::clamp(value + 0.5F, 0.0F, 255.0F));
  }
  return image;
}

Renderer::Column Renderer::look(const CameraPose& pose, int x) const {
  const double slope = (x - camera_.cx) / camera_.fx;
  const double c = std::cos(pose.heading);
  const double s = std::sin(pose.heading);
  const WallHit hit = place_.look(pose.x, pose.y, c + slope * s, s - slope * c);
  const double texels = kTexelsPerCell / style_.cell_m;
  Column column;
  column.depth_m = static_cast<float>(hit.distance_m);
  column.u = static_cast<float>(std::fmod(hit.along_m * texels, Texture::kTexels)) +
             offset_of(hit.section, 3);
  column.v = offset_of(hit.section, 4);
  column.contrast = static_cast<float>(hit.contrast);
  column.shade = hit.faces_x ? 1.0F : 0.86F;
  // Seen aslant a pixel covers more of the wall along than up; halfway between the two.
  const double facing = std::abs(hit.faces_x ? c + slope * s : s - slope * c);
  const double stretch = std::sqrt((1 + slope * slope) / std::max(facing, 0.05));
  column.level = texture_.level_of(
      static_cast<float>(hit.distance_m / camera_.fx * texels * std::min(stretch, 3.0)));
  return column;
}

float Renderer::flat(const CameraPose& pose, float depth_m, int x) const {
  const double side_m = depth_m * (x - camera_.cx) / camera_.fx;
  const double c = std::cos(pose.heading);
  const double s = std::sin(pose.heading);
  const double world_x = pose.x + depth_m * c + side_m * s;
  const double world_y = pose.y + depth_m * s - side_m * c;
  const double texels = kTexelsPerCell / style_.cell_m;
  const double along = depth_m / camera_.fx * texels;
  const double away = along * depth_m / style_.camera_m;
  const int level = texture_.level_of(static_cast<float>(std::sqrt(along * away)));
  return static_cast<float>(place_.floor_contrast(world_x, world_y)) *
         texture_.sample(static_cast<float>(world_x * texels), static_cast<float>(world_y * texels),
                         level);
}

void Renderer::add_view(const CameraPose& pose, std::vector<float>& sum, cv::Mat* depth) const {
  std::vector<Column> columns;
  columns.reserve(static_cast<std::size_t>(camera_.width_px));
  for (int x = 0; x < camera_.width_px; ++x) columns.push_back(look(pose, x));
  if (depth) depth->create(camera_.height_px, camera_.width_px, CV_32F);
  const auto eye_m = static_cast<float>(pose.z);
  const auto height_m = static_cast<float>(style_.height_m);
  const auto texels = static_cast<float>(kTexelsPerCell / style_.cell_m);
  std::size_t i = 0;
  for (int y = 0; y < camera_.height_px; ++y) {
    const auto down = static_cast<float>((y - camera_.cy) / camera_.fy);
    const float floor_m = down > 0 ? eye_m / down : 1e9F;
    const float ceiling_m = down < 0 ? (eye_m - height_m) / down : 1e9F;
    for (int x = 0; x < camera_.width_px; ++x, ++i) {
      const Column& column = columns[static_cast<std::size_t>(x)];
      float depth_m = column.depth_m;
      float value = 0;
      if (floor_m < depth_m) {
        depth_m = floor_m;
        value = 0.9F * kGray + flat(pose, depth_m, x);
      } else if (ceiling_m < depth_m) {
        depth_m = ceiling_m;
        value = style_.has_ceiling ? 1.15F * kGray + 0.5F * flat(pose, depth_m, x) : 1.7F * kGray;
      } else {
        const float up = eye_m - depth_m * down;
        value = column.shade *
                (kGray +
                 column.contrast * texture_.sample(column.u, column.v - up * texels, column.level));
      }
      sum[i] += value;
      if (depth) depth->at<float>(y, x) = depth_m;
    }
  }
}

}  // namespace orbbuf::evaluation
