// SPDX-License-Identifier: Apache-2.0
#include "daemon/image/jpeg_encoder.hpp"

#include <fmt/core.h>

#include <cstddef>
#include <limits>
#include <utility>

#include "common/wire.hpp"
#include "daemon/image/standard_head.hpp"

namespace orbbuf {
namespace {

constexpr int kMaxSidePx = std::numeric_limits<std::uint16_t>::max();

std::optional<Error> wrong_size(int width_px, int height_px) {
  if (width_px >= 1 && width_px <= kMaxSidePx && height_px >= 1 && height_px <= kMaxSidePx) {
    return std::nullopt;
  }
  return Error{fmt::format("cannot encode an image of {}x{} px: must be 1 to {} px wide and high",
                           width_px, height_px, kMaxSidePx)};
}

/// `raw`, of kYuv420 the luma, as the codec takes it. Fails if its data are fewer than it claims.
Result<ImageView> pixels_of(const RawFrame& raw) {
  if (auto error = wrong_size(raw.width_px, raw.height_px)) return std::move(*error);
  const int channels = raw.format == PixelFormat::kBgr24 ? 3 : 1;
  const auto row_bytes =
      static_cast<std::size_t>(raw.width_px) * static_cast<std::size_t>(channels);
  const auto rows_before_last = static_cast<std::size_t>(raw.height_px - 1);
  if (raw.stride_bytes < row_bytes || raw.data.size() < row_bytes ||
      (raw.data.size() - row_bytes) / raw.stride_bytes < rows_before_last ||
      (raw.format == PixelFormat::kYuv420 &&
       raw.data.size() < Yuv420Layout(raw.width_px, raw.height_px).bytes())) {
    return Error{fmt::format(
        "cannot encode an image of {}x{} px: {} bytes with rows of {} bytes are too few",
        raw.width_px, raw.height_px, raw.data.size(), raw.stride_bytes)};
  }
  return ImageView{raw.data.data(), raw.width_px, raw.height_px, raw.stride_bytes, channels};
}

}  // namespace

JpegEncoder::JpegEncoder(const JpegSettings& settings) : settings_(settings) {}

Result<EncodedFrame> JpegEncoder::encode(const RawFrame& raw, Sequence sequence) {
  auto left = encode_image(raw);
  if (!left) return std::move(left).error();
  auto& [width_px, height_px, jpeg] = left.value();
  EncodedFrame frame;
  frame.sequence = sequence;
  frame.capture_time_ns = raw.capture_time_ns;
  frame.exposure_ns = raw.exposure_ns;
  frame.width_px = static_cast<std::uint16_t>(width_px);
  frame.height_px = static_cast<std::uint16_t>(height_px);
  frame.left_bytes = static_cast<std::uint32_t>(jpeg.size());
  frame.jpeg = std::move(jpeg);
  if (raw.format != PixelFormat::kJpeg)
    frame.quality = static_cast<std::uint8_t>(settings_.quality);
  if (raw.right) {
    auto right = encode_image(*raw.right);
    if (!right) return Error{"right image: " + right.error().text};
    if (right.value().width_px != width_px || right.value().height_px != height_px) {
      return Error{fmt::format("left image of {}x{} px, right one of {}x{} px", width_px, height_px,
                               right.value().width_px, right.value().height_px)};
    }
    frame.jpeg.insert(frame.jpeg.end(), right.value().jpeg.begin(), right.value().jpeg.end());
  }
  frame.jpeg_crc = wire::crc32(frame.jpeg);
  return frame;
}

Result<JpegEncoder::Image> JpegEncoder::encode_image(const RawFrame& raw) {
  if (!raw.defect.empty()) return Error{raw.defect};
  if (raw.format == PixelFormat::kJpeg) {
    auto info = codec_.inspect(raw.data);
    if (!info) return std::move(info).error();
    const auto [width_px, height_px, is_gray, bytes, has_end] = info.value();
    if (auto error = wrong_size(width_px, height_px)) return std::move(*error);
    Image image{width_px, height_px, with_standard_head(raw.data.first(bytes))};
    if (!has_end) image.jpeg.insert(image.jpeg.end(), {0xFF, 0xD9});
    return image;
  }
  auto view = pixels_of(raw);
  if (!view) return std::move(view).error();
  auto jpeg = raw.format == PixelFormat::kYuv420 && settings_.color
                  ? codec_.encode_yuv420(raw.data, raw.width_px, raw.height_px, settings_.quality)
                  : codec_.encode(view.value(), settings_.quality, settings_.color);
  if (!jpeg) return std::move(jpeg).error();
  return Image{raw.width_px, raw.height_px, std::move(jpeg).value()};
}

}  // namespace orbbuf
