// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/camera_unpack.hpp"

#include <spdlog/fmt/fmt.h>

#include <cstring>
#include <memory>

namespace orbbuf {
namespace {

/// Copies one row of `width` pixels.
using CopyRow = void (*)(const std::uint8_t* from, std::uint8_t* to, std::size_t width);

struct Layout {
  PixelFormat format;
  std::size_t bytes_per_pixel;  ///< of the first plane, as it comes
  CopyRow copy_row;
};

template <std::size_t BytesPerPixel>
void copy_whole(const std::uint8_t* from, std::uint8_t* to, std::size_t width) {
  std::memcpy(to, from, width * BytesPerPixel);
}

/// The luma of a row in which a byte of it and one of chroma take turns, `First` of two.
template <std::size_t First>
void copy_luma(const std::uint8_t* from, std::uint8_t* to, std::size_t width) {
  for (std::size_t x = 0; x < width; ++x) to[x] = from[2 * x + First];
}

void swap_red_and_blue(const std::uint8_t* from, std::uint8_t* to, std::size_t width) {
  for (std::size_t x = 0; x < 3 * width; x += 3) {
    to[x] = from[x + 2];
    to[x + 1] = from[x + 1];
    to[x + 2] = from[x];
  }
}

Layout layout_of(CameraFormat format) {
  switch (format) {
    case CameraFormat::kYuyv:
      return {PixelFormat::kGray8, 2, copy_luma<0>};
    case CameraFormat::kUyvy:
      return {PixelFormat::kGray8, 2, copy_luma<1>};
    case CameraFormat::kBgr24:
      return {PixelFormat::kBgr24, 3, copy_whole<3>};
    case CameraFormat::kRgb24:
      return {PixelFormat::kBgr24, 3, swap_red_and_blue};
    case CameraFormat::kMjpg:
      return {PixelFormat::kJpeg, 1, copy_whole<1>};
    default:
      return {PixelFormat::kGray8, 1, copy_whole<1>};
  }
}

/// Lets `frame` own `bytes` of memory, not yet written.
std::uint8_t* allocate(RawFrame& frame, std::size_t bytes) {
  auto memory = std::make_shared_for_overwrite<std::uint8_t[]>(bytes);
  std::uint8_t* const begin = memory.get();
  frame.data = {begin, bytes};
  frame.lease = std::move(memory);
  return begin;
}

}  // namespace

RawFrame unpack(const CameraMode& mode, std::span<const std::uint8_t> data) {
  const Layout layout = layout_of(mode.format);
  RawFrame frame;
  frame.width_px = mode.width_px;
  frame.height_px = mode.height_px;
  frame.format = layout.format;
  if (data.empty()) {
    frame.defect = "the camera's driver returned an empty buffer";
    return frame;
  }
  if (mode.format == CameraFormat::kMjpg) {
    layout.copy_row(data.data(), allocate(frame, data.size()), data.size());
    return frame;
  }
  const auto width = static_cast<std::size_t>(mode.width_px);
  const auto height = static_cast<std::size_t>(mode.height_px);
  const std::size_t needed = (height - 1) * mode.stride_bytes + width * layout.bytes_per_pixel;
  if (data.size() < needed) {
    frame.defect = fmt::format("the camera's driver returned a truncated image: {} of {} bytes",
                               data.size(), needed);
    return frame;
  }
  frame.stride_bytes = width * (layout.format == PixelFormat::kBgr24 ? 3 : 1);
  std::uint8_t* const to = allocate(frame, height * frame.stride_bytes);
  for (std::size_t y = 0; y < height; ++y) {
    layout.copy_row(data.data() + y * mode.stride_bytes, to + y * frame.stride_bytes, width);
  }
  return frame;
}

}  // namespace orbbuf
