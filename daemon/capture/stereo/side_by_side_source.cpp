// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/stereo/side_by_side_source.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

namespace orbbuf {
namespace {

/// Says what is wrong; nothing is changed then.
std::string split_pixels(RawFrame& frame) {
  if (frame.width_px < 2 || frame.width_px % 2 != 0) {
    return fmt::format("cannot split an image of {}x{} px: its width is odd or too small",
                       frame.width_px, frame.height_px);
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
