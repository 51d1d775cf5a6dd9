// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace orbbuf::vm {

/// What the camera captures: the formats by their index in the descriptors, from 1, each in all
/// sizes.
inline constexpr std::uint8_t kUncompressed = 1;  // YUYV
inline constexpr std::uint8_t kMotionJpeg = 2;

struct UvcSize {
  std::uint16_t width_px;
  std::uint16_t height_px;
};
inline constexpr std::array<UvcSize, 2> kUvcSizes = {{{320, 240}, {640, 480}}};
inline constexpr std::uint32_t kUvcRate = 15;
inline constexpr std::uint32_t kUvcInterval = 10'000'000 / kUvcRate;  // in units of 100 ns

/// Descriptors of a camera by the USB Video Class 1.0, which streams over bulk endpoint 1.
std::vector<std::uint8_t> device_descriptor();
std::vector<std::uint8_t> configuration_descriptor();
/// index: 0: languages; 1: maker; 2: product; 3: serial number.
std::vector<std::uint8_t> string_descriptor(std::uint8_t index);

}  // namespace orbbuf::vm
