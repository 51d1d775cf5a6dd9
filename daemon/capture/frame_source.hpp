// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <utility>

namespace orbbuf {

enum class PixelFormat {
  kGray8,   ///< one byte a pixel
  kBgr24,   ///< blue, green, red
  kYuv420,  ///< planes of a Yuv420Layout (common/jpeg.hpp)
  kJpeg,    ///< one complete JPEG; width and height may be 0 (unknown), stride is unused
};

/// One image as the source has it. `data` is valid for as long as `lease` is held; letting go of
/// it, on any thread, gives the memory back to the source.
struct RawFrame {
  std::int64_t capture_time_ns = 0;
  std::int64_t monotonic_ns = 0;   ///< cameras: the same, by the clock that is never set
  std::int64_t clock_step_ns = 0;  ///< ROS 2: its clock was set by so much since the session began
  std::uint32_t exposure_ns = 0;   ///< 0: unknown
  int width_px = 0;
  int height_px = 0;
  std::size_t stride_bytes = 0;  ///< from row to row; kYuv420: of the luma
  PixelFormat format = PixelFormat::kGray8;
  std::span<const std::uint8_t> data;
  std::shared_ptr<const void> lease;
  std::string defect;  ///< not empty: the image could not be read, and why; `data` is empty
  /// Stereo: the right image, of which only what describes the image counts. Null: there is none.
  std::shared_ptr<const RawFrame> right;
};

inline RawFrame frame_with_defect(std::string why) {
  RawFrame frame;
  frame.defect = std::move(why);
  return frame;
}

/// Where frames come from. Thread-bound to `capture`, but for construction and destruction.
class FrameSource {
 public:
  virtual ~FrameSource() = default;

  /// The next frame in capture order; waits for it. Nothing at the end of a finite source, or soon
  /// after `stop` is requested. A frame that is there but unreadable is returned with `defect` set,
  /// so that it is counted and named. Throws std::runtime_error when the source as a whole is gone.
  virtual std::optional<RawFrame> next(std::stop_token stop) = 0;

  /// True: frames come at their own pace, and one that is not taken in time is lost to its
  /// successor. False: the source waits for its reader and nothing need be lost.
  virtual bool is_live() const = 0;

  /// One line for the log: what, where, size and rate.
  virtual std::string description() const = 0;
};

}  // namespace orbbuf
