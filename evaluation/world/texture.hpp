// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace orbbuf::evaluation {

/// Leaves of every size, one over the other: as rich in edges and corners near as far, as real
/// surfaces are. Repeats after kTexels.
class Texture {
 public:
  static constexpr int kTexels = 2048;

  explicit Texture(std::uint64_t seed);

  /// Brightness at (u, v) in texels, -128 to 127, mean about 0, seen with `level` (see level_of).
  float sample(float u, float v, int level) const {
    const cv::Mat& image = levels_[static_cast<std::size_t>(level)];
    const float scale = 1.0F / static_cast<float>(1 << level);
    u = u * scale - 0.5F;
    v = v * scale - 0.5F;
    const auto floor_u = static_cast<int>(u) - (u < 0 ? 1 : 0);
    const auto floor_v = static_cast<int>(v) - (v < 0 ? 1 : 0);
    const float right = u - static_cast<float>(floor_u);
    const float down = v - static_cast<float>(floor_v);
    const int mask = image.cols - 1;
    const auto* top = image.ptr<std::uint8_t>(floor_v & mask);
    const auto* bottom = image.ptr<std::uint8_t>((floor_v + 1) & mask);
    const int x0 = floor_u & mask;
    const int x1 = (floor_u + 1) & mask;
    const auto above =
        static_cast<float>(top[x0]) * (1 - right) + static_cast<float>(top[x1]) * right;
    const auto below =
        static_cast<float>(bottom[x0]) * (1 - right) + static_cast<float>(bottom[x1]) * right;
    return above * (1 - down) + below * down - 128;
  }

  /// The level to sample where a pixel covers so many texels each way.
  int level_of(float texels) const {
    int level = 0;
    for (; texels > 1.4F && level + 1 < static_cast<int>(levels_.size()); texels *= 0.5F) ++level;
    return level;
  }

 private:
  std::vector<cv::Mat> levels_;  ///< each half as wide as the one before
};

}  // namespace orbbuf::evaluation
