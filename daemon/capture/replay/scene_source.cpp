// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/scene_source.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "daemon/capture/replay/replay_frame.hpp"
#include "daemon/capture/replay/scene_pose.hpp"

namespace orbbuf {
namespace {

/// SplitMix64 (Steele, Lea, Flood, OOPSLA 2014). The standard library's distributions differ from
/// one implementation to the next.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}

  /// 0 .. limit-1
  int below(int limit) {
    state_ += 0x9E3779B97F4A7C15U;
    auto z = state_;
    z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
    z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
    z ^= z >> 31U;
    return static_cast<int>((z >> 32U) * static_cast<std::uint64_t>(limit) >> 32U);
  }

 private:
  std::uint64_t state_;
};

/// Sets the pixels within `reach` of (x0, y0) that `covers(dx, dy)`, with x and y wrapped.
template <class Covers>
void fill(SceneCanvas& canvas, int x0, int y0, int reach, const std::array<std::uint8_t, 3>& color,
          const Covers& covers) {
  const int mask = canvas.side_px - 1;
  for (int dy = -reach; dy <= reach; ++dy) {
    const auto row =
        static_cast<std::size_t>((y0 + dy) & mask) * static_cast<std::size_t>(canvas.side_px);
    for (int dx = -reach; dx <= reach; ++dx) {
      if (!covers(dx, dy)) continue;
      const auto at = row + static_cast<std::size_t>((x0 + dx) & mask);
      std::copy_n(color.begin(), canvas.channels,
                  canvas.pixels.begin() + static_cast<std::ptrdiff_t>(at) * canvas.channels);
    }
  }
}

/// One bar (at any angle), box or disc of about `radius` somewhere.
void draw_shape(SceneCanvas& canvas, Random& random, int radius) {
  const int x = random.below(canvas.side_px);
  const int y = random.below(canvas.side_px);
  const int kind = random.below(3);
  const int a = radius / 3 + random.below(radius);
  const int b = radius / 3 + random.below(radius);
  const bool is_mirrored = random.below(2) == 1;
  std::array<std::uint8_t, 3> color{};
  for (auto& c : color) c = static_cast<std::uint8_t>(32 + random.below(192));

  if (kind == 0) {
    fill(canvas, x, y, std::max(a, b), color,
         [=](int dx, int dy) { return std::abs(dx) <= a && std::abs(dy) <= b; });
  } else if (kind == 1) {
    fill(canvas, x, y, a, color, [=](int dx, int dy) { return dx * dx + dy * dy <= a * a; });
  } else {
    // Along (a, b), three times as long as it is wide; squared lengths, so nothing is divided.
    const int along = is_mirrored ? -a : a;
    const int length2 = a * a + b * b;
    fill(canvas, x, y, 2 * std::max(a, b), color, [=](int dx, int dy) {
      const int forward = dx * along + dy * b;
      const int sideways = dx * b - dy * along;
      return std::abs(forward) <= length2 && 3 * std::abs(sideways) <= length2;
    });
  }
}

/// Largest first, so that the small ones lie on top; every size covers about as much area.
void draw_shapes(SceneCanvas& canvas, Random& random) {
  for (int radius = 96; radius >= 6; radius /= 2) {
    const int count = canvas.side_px / radius * (canvas.side_px / radius) / 16;
    for (int i = 0; i < count; ++i) draw_shape(canvas, random, radius);
  }
}

/// Adds value noise with a grid of 2^shift pixels: random at the grid's points, linear between.
void add_noise(SceneCanvas& canvas, Random& random, int shift, int amplitude) {
  const int cell = 1 << shift;
  const int points = canvas.side_px >> shift;
  std::vector<int> grid(static_cast<std::size_t>(points) * static_cast<std::size_t>(points));
  for (auto& value : grid) value = random.below(2 * amplitude + 1) - amplitude;
  const auto point = [&](int column, int row) {
    column &= points - 1;
    row &= points - 1;
    return grid[static_cast<std::size_t>(row) * static_cast<std::size_t>(points) +
                static_cast<std::size_t>(column)];
  };
  auto* pixel = canvas.pixels.data();
  for (int y = 0; y < canvas.side_px; ++y) {
    const int fy = y & (cell - 1);
    for (int column = 0; column < points; ++column) {
      const int left =
          point(column, y >> shift) * (cell - fy) + point(column, (y >> shift) + 1) * fy;
      const int right =
          point(column + 1, y >> shift) * (cell - fy) + point(column + 1, (y >> shift) + 1) * fy;
      for (int fx = 0; fx < cell; ++fx) {
        const int noise = (left * (cell - fx) + right * fx) / (cell * cell);
        for (int c = 0; c < canvas.channels; ++c, ++pixel) {
          *pixel = static_cast<std::uint8_t>(std::clamp(*pixel + noise, 0, 255));
        }
      }
    }
  }
}

constexpr int kMinSidePx = 64;
constexpr int kMaxSidePx = 4096;
constexpr int kMinCanvasPx = 512;
constexpr unsigned kMaxCanvasPx = 4096;

/// `value` modulo `period`, 0 or more.
double wrapped(double value, double period) { return value - std::floor(value / period) * period; }

}  // namespace

SceneCanvas make_scene_canvas(std::uint64_t seed, int side_px, int channels) {
  SceneCanvas canvas{side_px, channels, {}};
  const auto side = static_cast<std::size_t>(side_px);
  canvas.pixels.assign(side * side * static_cast<std::size_t>(channels), 128);
  Random random(seed);
  draw_shapes(canvas, random);
  for (int shift = 3; shift <= 7; ++shift) add_noise(canvas, random, shift, 4 * (shift - 1));
  return canvas;
}

SceneSource::SceneSource(const SourceSettings& settings) : settings_(settings) {
  const int longer = std::max(settings.width_px, settings.height_px);
  if (std::min(settings.width_px, settings.height_px) < kMinSidePx || longer > kMaxSidePx ||
      settings.frames < 1) {
    throw std::runtime_error(fmt::format(
        "cannot generate {} frames of {}x{} px: must be at least 1 frame, {} to {} px wide and "
        "high",
        settings.frames, settings.width_px, settings.height_px, kMinSidePx, kMaxSidePx));
  }
  cv::setNumThreads(1);  // a camera takes no processor from the other threads
  const int side = static_cast<int>(std::clamp(std::bit_ceil(static_cast<unsigned>(3 * longer)),
                                               0U + kMinCanvasPx, kMaxCanvasPx));
  auto canvas = make_scene_canvas(settings.seed, side, settings.color ? 3 : 1);
  canvas_side_px_ = side;
  // Views too large for the canvas are magnified, lest they see the same thing twice.
  canvas_px_per_px_ = std::min(1.0, side / (2.5 * longer));
  const double diagonal = std::hypot(settings.width_px, settings.height_px);
  const int margin =
      static_cast<int>(std::ceil(diagonal / 2 * (1 + kSceneZoomDepth) * canvas_px_per_px_)) + 2;
  margin_px_ = margin;
  const cv::Mat once(side, side, settings.color ? CV_8UC3 : CV_8UC1, canvas.pixels.data());
  cv::copyMakeBorder(once, canvas_, margin, margin, margin, margin, cv::BORDER_WRAP);
}

/// From the pixels of a frame to those of canvas_.
cv::Matx23d SceneSource::view_at(double time_s) const {
  const ScenePose pose = scene_pose_at(time_s);
  const double width = settings_.width_px * canvas_px_per_px_;
  const double zoom = pose.zoom * canvas_px_per_px_;
  const double c = zoom * std::cos(pose.roll_rad);
  const double s = zoom * std::sin(pose.roll_rad);
  const double x = margin_px_ + wrapped(width * pose.x, canvas_side_px_);
  const double y = margin_px_ + wrapped(width * pose.y, canvas_side_px_);
  const double half_width = (settings_.width_px - 1) / 2.0;
  const double half_height = (settings_.height_px - 1) / 2.0;
  return {c, -s, x - c * half_width + s * half_height,  //
          s, c,  y - s * half_width - c * half_height};
}

std::optional<RawFrame> SceneSource::next(std::stop_token stop) {
  if (index_ == settings_.frames || stop.stop_requested()) return std::nullopt;
  const auto view = view_at(static_cast<double>(index_) / settings_.fps);
  const auto time_ns = nominal_time_ns(index_++, settings_.fps);
  cv::Mat image;
  cv::warpAffine(canvas_, image, view, {settings_.width_px, settings_.height_px},
                 cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
  return replay_frame(std::move(image), time_ns);
}

std::string SceneSource::description() const {
  return fmt::format("generated scene {}: {} frames of {}x{} px, {:.4g} fps", settings_.seed,
                     settings_.frames, settings_.width_px, settings_.height_px, settings_.fps);
}

}  // namespace orbbuf
