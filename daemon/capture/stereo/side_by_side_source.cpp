// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/stereo/side_by_side_source.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include "daemon/capture/camera_unpack.hpp"

namespace orbbuf {
namespace {

/// One half of a kYuv420 image, which begins at column `left_px`, in memory of its own.
RawFrame half_of(const RawFrame& whole, int left_px) {
  const Yuv420Layout planes(whole.width_px, whole.height_px);
  const auto left = static_cast<std::size_t>(left_px);
  const auto blue = whole.data.subspan(planes.luma_bytes() + left / 2);
  CameraMode mode;
  mode.format = CameraFormat::kYuv420;
  mode.width_px = whole.width_px / 2;
  mode.height_px = whole.height_px;
  mode.stride_bytes = whole.stride_bytes;
  mode.color = true;
  return unpack(mode, whole.data.subspan(left), {blue, blue.subspan(planes.chroma_bytes())});
}

void split_yuv420(RawFrame& frame) {
  const int half_px = frame.width_px / 2;
  const RawFrame left = half_of(frame, 0);
  frame.right = std::make_shared<RawFrame>(half_of(frame, half_px));
  frame.width_px = half_px;
  frame.stride_bytes = left.stride_bytes;
  frame.data = left.data;
  frame.lease = left.lease;
}

/// Says what is wrong; nothing is changed then.
std::string split_pixels(RawFrame& frame) {
  if (frame.width_px < 2 || frame.width_px % 2 != 0) {
    return fmt::format("cannot split an image of {}x{} px: its width is odd or too small",
                       frame.width_px, frame.height_px);
  }
  if (frame.format == PixelFormat::kYuv420) {
    split_yuv420(frame);
    return {};
  }
  frame.width_px /= 2;
  auto right = std::make_shared<RawFrame>(frame);
  const auto pixel_bytes = frame.format == PixelFormat::kBgr24 ? 3U : 1U;
  const auto left_bytes = static_cast<std::size_t>(frame.width_px) * pixel_bytes;
  right->data = frame.data.subspan(std::min(left_bytes, frame.data.size()));
  frame.right = std::move(right);
  return {};
}

void hold(RawFrame& frame, std::vector<std::uint8_t> jpeg) {
  auto owner = std::make_shared<const std::vector<std::uint8_t>>(std::move(jpeg));
  frame.format = PixelFormat::kJpeg;
  frame.width_px = 0;
  frame.height_px = 0;
  frame.data = *owner;
  frame.lease = std::move(owner);
}

}  // namespace

SideBySideSource::SideBySideSource(std::unique_ptr<FrameSource> source)
    : source_(std::move(source)) {}

std::optional<RawFrame> SideBySideSource::next(std::stop_token stop) {
  auto frame = source_->next(std::move(stop));
  if (!frame || !frame->defect.empty()) return frame;
  frame->defect = frame->format == PixelFormat::kJpeg ? split_jpeg(*frame) : split_pixels(*frame);
  if (frame->defect.empty()) return frame;
  frame->data = {};
  frame->lease.reset();
  return frame;
}

std::string SideBySideSource::split_jpeg(RawFrame& frame) {
  auto halves = codec_.halve(frame.data);
  if (!halves) return halves.error().text;
  auto right = std::make_shared<RawFrame>();
  hold(*right, std::move(halves.value().right));
  hold(frame, std::move(halves.value().left));
  frame.right = std::move(right);
  return {};
}

std::string SideBySideSource::description() const {
  return source_->description() + ", left and right side by side";
}

}  // namespace orbbuf
