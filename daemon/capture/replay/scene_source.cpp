// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/scene_source.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

#include "daemon/capture/replay/replay_frame.hpp"
#include "daemon/capture/replay/scene_canvas.hpp"

namespace orbbuf {
namespace {

constexpr int kMinSidePx = 64;
constexpr int kMaxSidePx = 4096;
constexpr int kMinCanvasPx = 512;
constexpr unsigned kMaxCanvasPx = 4096;

constexpr double kCycleS = 12.0;
constexpr double kTurnS = 3.0;       // the last of each cycle
constexpr double kSlowSpeed = 0.06;  // view widths a second
constexpr double kTurnSpeed = 1.8;   // the same, added at the middle of the turn
constexpr double kZoomDepth = 0.2;   // the view is up to so much wider or narrower
constexpr double kRollDepth = 0.25;  // radians either way

/// How far the camera has come, in view widths. Everything it does is a smooth function of this, so
/// that this alone makes the slow stretches slow and the turns fast.
double path_at(double time_s) {
  const double cycles = std::floor(time_s / kCycleS);
  const double in_cycle_s = time_s - cycles * kCycleS;
  const double in_turn_s = std::max(0.0, in_cycle_s - (kCycleS - kTurnS));
  // The speed of a turn is kTurnSpeed * sin^2(pi s / kTurnS); this is its integral.
  const double turned =
      kTurnSpeed * (in_turn_s / 2 - kTurnS / (4 * std::numbers::pi) *
                                        std::sin(2 * std::numbers::pi * in_turn_s / kTurnS));
  return kSlowSpeed * time_s + cycles * kTurnSpeed * kTurnS / 2 + turned;
}

/// `value` modulo `period`, 0 or more.
double wrapped(double value, double period) { return value - std::floor(value / period) * period; }

}  // namespace

SceneSource::SceneSource(const SourceSettings& settings) : settings_(settings) {
  const int longer = std::max(settings.width_px, settings.height_px);
  if (std::min(settings.width_px, settings.height_px) < kMinSidePx || longer > kMaxSidePx ||
      settings.frames < 1) {
    throw std::runtime_error(fmt::format(
        "cannot generate {} frames of {}x{} px: must be at least 1 frame, {} to {} px wide and "
        "high",
        settings.frames, settings.width_px, settings.height_px, kMinSidePx, kMaxSidePx));
  }
  const int side = static_cast<int>(std::clamp(std::bit_ceil(static_cast<unsigned>(3 * longer)),
                                               0U + kMinCanvasPx, kMaxCanvasPx));
  auto canvas = make_scene_canvas(settings.seed, side, settings.color ? 3 : 1);
  canvas_side_px_ = side;
  // Views too large for the canvas are magnified, lest they see the same thing twice.
  canvas_px_per_px_ = std::min(1.0, side / (2.5 * longer));
  const double diagonal = std::hypot(settings.width_px, settings.height_px);
  const int margin =
      static_cast<int>(std::ceil(diagonal / 2 * (1 + kZoomDepth) * canvas_px_per_px_)) + 2;
  margin_px_ = margin;
  const cv::Mat once(side, side, settings.color ? CV_8UC3 : CV_8UC1, canvas.pixels.data());
  cv::copyMakeBorder(once, canvas_, margin, margin, margin, margin, cv::BORDER_WRAP);
}

/// From the pixels of a frame to those of canvas_.
cv::Matx23d SceneSource::view_at(double time_s) const {
  const double path = path_at(time_s);
  const double width = settings_.width_px * canvas_px_per_px_;
  const double zoom = (1 + kZoomDepth * std::sin(0.7 * path)) * canvas_px_per_px_;
  const double roll = kRollDepth * std::sin(1.1 * path);
  const double c = zoom * std::cos(roll);
  const double s = zoom * std::sin(roll);
  const double x = margin_px_ + wrapped(width * path, canvas_side_px_);
  const double y =
      margin_px_ + wrapped(width * (0.3 * path + 0.2 * std::sin(0.9 * path)), canvas_side_px_);
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
