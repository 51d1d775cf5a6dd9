// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/camera_unpack.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cstring>
#include <memory>

#include "common/jpeg.hpp"

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

/// The samples of one chroma in a driver's buffer: one for two pixels of a row.
struct Chroma {
  std::span<const std::uint8_t> bytes;  ///< from the first sample on
  std::size_t step;                     ///< from sample to sample
  std::size_t stride;                   ///< from row to row
  std::size_t rows;                     ///< for two rows of pixels: 1, or 2, whose mean is taken
};

/// Blue and red. `mode.format` is a YUV format.
std::array<Chroma, 2> chroma_of(const CameraMode& mode, std::span<const std::uint8_t> data,
                                const ChromaPlanes& planes) {
  const auto behind = [data](std::size_t offset) {
    return data.subspan(std::min(offset, data.size()));
  };
  const std::size_t stride = mode.stride_bytes;
  const auto height = static_cast<std::size_t>(mode.height_px);
  switch (mode.format) {
    case CameraFormat::kYuyv:
      return {{{behind(1), 4, stride, 2}, {behind(3), 4, stride, 2}}};
    case CameraFormat::kUyvy:
      return {{{behind(0), 4, stride, 2}, {behind(2), 4, stride, 2}}};
    case CameraFormat::kNv12: {
      const auto both = planes[0].empty() ? behind(stride * height) : planes[0];
      return {{{both, 2, stride, 1}, {both.subspan(both.empty() ? 0 : 1), 2, stride, 1}}};
    }
    default: {
      const std::size_t half = (stride + 1) / 2;
      const auto blue = planes[0].empty() ? behind(stride * height) : planes[0];
      const auto red =
          planes[1].empty() ? behind(stride * height + half * ((height + 1) / 2)) : planes[1];
      return {{{blue, 1, half, 1}, {red, 1, half, 1}}};
    }
  }
}

template <std::size_t Step>
void copy_mean(const std::uint8_t* a, const std::uint8_t* b, std::uint8_t* to, std::size_t count) {
  for (std::size_t x = 0; x < count; ++x) {
    to[x] = static_cast<std::uint8_t>((a[x * Step] + b[x * Step] + 1) / 2);
  }
}

/// Writes one chroma plane of `layout`, for an image `height` pixels high. False: too few bytes.
bool copy_chroma(const Chroma& from, const Yuv420Layout& layout, std::size_t height,
                 std::uint8_t* to) {
  const std::size_t rows = from.rows == 2 ? height : layout.rows;
  const std::size_t last = (rows - 1) * from.stride + (layout.columns - 1) * from.step;
  if (from.bytes.size() <= last) return false;
  for (std::size_t y = 0; y < rows; y += from.rows, to += layout.columns) {
    const std::uint8_t* const row = from.bytes.data() + y * from.stride;
    const std::uint8_t* const next = from.rows == 2 && y + 1 < rows ? row + from.stride : row;
    if (from.step == 1) {
      std::memcpy(to, row, layout.columns);
    } else if (from.step == 2) {
      copy_mean<2>(row, next, to, layout.columns);
    } else {
      copy_mean<4>(row, next, to, layout.columns);
    }
  }
  return true;
}

/// Lets `frame` own `bytes` of memory, not yet written.
std::uint8_t* allocate(RawFrame& frame, std::size_t bytes) {
  auto memory = std::make_shared_for_overwrite<std::uint8_t[]>(bytes);
  std::uint8_t* const begin = memory.get();
  frame.data = {begin, bytes};
  frame.lease = std::move(memory);
  return begin;
}

void copy_rows(const Layout& layout, const CameraMode& mode, std::span<const std::uint8_t> data,
               std::uint8_t* to, std::size_t to_stride) {
  for (std::size_t y = 0; y < static_cast<std::size_t>(mode.height_px); ++y) {
    layout.copy_row(data.data() + y * mode.stride_bytes, to + y * to_stride,
                    static_cast<std::size_t>(mode.width_px));
  }
}

/// Repeats the last column and row where the width or height is odd.
void pad_luma(std::uint8_t* luma, const Yuv420Layout& layout, std::size_t width,
              std::size_t height) {
  const std::size_t stride = 2 * layout.columns;
  for (std::size_t y = 0; width % 2 != 0 && y < height; ++y) {
    luma[y * stride + width] = luma[y * stride + width - 1];
  }
  if (height % 2 != 0) std::memcpy(luma + height * stride, luma + (height - 1) * stride, stride);
}

/// `data` hold the luma.
void copy_yuv420(RawFrame& frame, const CameraMode& mode, std::span<const std::uint8_t> data,
                 const ChromaPlanes& chroma) {
  const Yuv420Layout planes(mode.width_px, mode.height_px);
  const auto height = static_cast<std::size_t>(mode.height_px);
  frame.format = PixelFormat::kYuv420;
  frame.stride_bytes = 2 * planes.columns;
  std::uint8_t* const luma = allocate(frame, planes.bytes());
  std::uint8_t* const first_chroma = luma + planes.luma_bytes();
  copy_rows(layout_of(mode.format), mode, data, luma, frame.stride_bytes);
  pad_luma(luma, planes, static_cast<std::size_t>(mode.width_px), height);
  const auto [blue, red] = chroma_of(mode, data, chroma);
  if (copy_chroma(blue, planes, height, first_chroma) &&
      copy_chroma(red, planes, height, first_chroma + planes.chroma_bytes())) {
    return;
  }
  frame.defect = "the camera's driver returned a truncated image: its chroma is not complete";
  frame.data = {};
  frame.lease.reset();
}

}  // namespace

RawFrame unpack(const CameraMode& mode, std::span<const std::uint8_t> data,
                const ChromaPlanes& chroma) {
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
  const std::uint64_t needed =
      std::uint64_t{height - 1} * mode.stride_bytes + width * layout.bytes_per_pixel;
  if (data.size() < needed) {
    frame.defect = fmt::format("the camera's driver returned a truncated image: {} of {} bytes",
                               data.size(), needed);
    return frame;
  }
  if (mode.color && is_yuv(mode.format)) {
    copy_yuv420(frame, mode, data, chroma);
    return frame;
  }
  frame.stride_bytes = width * (layout.format == PixelFormat::kBgr24 ? 3 : 1);
  copy_rows(layout, mode, data, allocate(frame, height * frame.stride_bytes), frame.stride_bytes);
  return frame;
}

}  // namespace orbbuf
