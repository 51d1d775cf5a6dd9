// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <utility>

#include "daemon/capture/frame_source.hpp"

namespace orbbuf {

/// `image` (CV_8UC1 or CV_8UC3, not empty) as a frame that keeps it alive. No pixel is copied.
inline RawFrame replay_frame(cv::Mat image, std::int64_t capture_time_ns) {
  auto owner = std::make_shared<const cv::Mat>(std::move(image));
  RawFrame frame;
  frame.capture_time_ns = capture_time_ns;
  frame.width_px = owner->cols;
  frame.height_px = owner->rows;
  frame.stride_bytes = owner->step[0];
  frame.format = owner->channels() == 1 ? PixelFormat::kGray8 : PixelFormat::kBgr24;
  frame.data = {owner->data, static_cast<std::size_t>(owner->dataend - owner->datastart)};
  frame.lease = std::move(owner);
  return frame;
}

}  // namespace orbbuf
