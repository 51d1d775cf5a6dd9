// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "daemon/capture/frame_source.hpp"
#include "daemon/capture/source_settings.hpp"

namespace orbbuf {

/// A square picture that continues over its edges, full of corners at every scale: bars, boxes and
/// discs from 4 to 360 pixels on a ground of noise. Content, not photography: what matters is that
/// features are found everywhere and that no two places look alike.
struct SceneCanvas {
  int side_px = 0;   ///< a power of 2
  int channels = 1;  ///< 1 or 3, interleaved
  std::vector<std::uint8_t> pixels;
};

/// side_px: a power of 2, at least 512. Made with integers alone, so that one seed gives the same
/// bytes on every machine. About 0.1 s for 2048 x 2048 gray.
SceneCanvas make_scene_canvas(std::uint64_t seed, int side_px, int channels);

/// A camera over a generated world (SceneCanvas), for the demo and for tests: frames as a
/// robot's camera gives them, from a seed instead of a data set.
///
/// It pans, turns and zooms smoothly, in cycles of 12 s from time 0: 9 s slowly, where frames a
/// second apart still share over 90 % of the view, then a turn of 3 s, in the middle second of
/// which the view is replaced altogether. So one second of frames lost costs little or everything.
///
/// One seed and size give the same bytes every time on one machine. Between kinds of processor the
/// world is the same; the view may differ by the rounding of the warp.
/// Cost: about 1 ms for a frame of 640x480 gray, on its thread alone: it sets OpenCV to one thread
/// in this process. At its reader's pace; see ReplaySource.
class SceneSource : public FrameSource {
 public:
  /// width_px, height_px: 64..4096; frames: at least 1. Throws std::runtime_error otherwise.
  /// Memory: 9 MB for 640x480 gray, at most 50 MB; three times that in colour.
  explicit SceneSource(const SourceSettings& settings);

  std::optional<RawFrame> next(std::stop_token stop) override;
  bool is_live() const override { return false; }
  std::string description() const override;

 private:
  cv::Matx23d view_at(double time_s) const;

  SourceSettings settings_;
  double canvas_px_per_px_;  ///< at zoom 1
  double canvas_side_px_;
  double margin_px_;  ///< how far a view can reach from its centre, in canvas pixels
  cv::Mat canvas_;    ///< wrapped on by the margin on all sides, so that no view leaves it
  std::int64_t index_ = 0;
};

}  // namespace orbbuf
