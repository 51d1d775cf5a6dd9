// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <utility>

#include "daemon/capture/frame_source.hpp"

namespace orbbuf {

/// The rates for which times in whole nanoseconds neither repeat nor, for years, overflow.
inline constexpr double kMinFps = 1e-3;
inline constexpr double kMaxFps = 1e6;

inline bool is_usable_fps(double fps) { return fps >= kMinFps && fps <= kMaxFps; }

/// When frame `index` of a stream of exactly `fps` frames per second is due, rounded to the
/// nanosecond from the start of the stream each time, so that no error adds up.
inline std::int64_t nominal_time_ns(std::int64_t index, double fps) {
  return std::llround(static_cast<double>(index) * 1e9 / fps);
}

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
