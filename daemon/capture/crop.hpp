// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <optional>
#include <string>
#include <string_view>

namespace orbbuf {

/// A part of what a camera's sensor sees, in the sensor's pixels.
struct Crop {
  int width_px = 0;
  int height_px = 0;
  int left_px = 0;
  int top_px = 0;

  auto operator<=>(const Crop&) const = default;
};

/// Of "WIDTHxHEIGHT+LEFT+TOP", e.g. "640x480+320+120": whole numbers below 100000, sizes not 0.
/// Nothing if `text` is not that.
std::optional<Crop> parse_crop(std::string_view text);

/// As parse_crop() reads it.
std::string to_string(const Crop& crop);

}  // namespace orbbuf
