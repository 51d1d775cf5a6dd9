// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace orbbuf::test {

/// A JPEG of noise, in gray or in 4:2:2 colour, with a restart marker after each row of blocks.
/// Before each of them are `spare` bytes that are no data, as the cameras Logitech C270 and C910
/// send them.
std::vector<std::uint8_t> restart_jpeg(int width_px, int height_px, bool is_color,
                                       std::size_t spare);

/// `jpeg` with `count` zeros behind the first segment of its head, as cameras of Dahua send them.
std::vector<std::uint8_t> with_zeros_in_head(std::vector<std::uint8_t> jpeg, std::size_t count);

}  // namespace orbbuf::test
