// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

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

}  // namespace orbbuf
