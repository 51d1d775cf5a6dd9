// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace orbbuf {

/// Number of a frame within its session: 0, 1, 2, ... in capture order, without gaps.
using Sequence = std::uint64_t;

inline constexpr std::uint8_t kMaxQuality = 100;

/// One captured image, or the pair of a stereo camera, as it travels: immutable once made, so any
/// thread may read it.
struct EncodedFrame {
  Sequence sequence = 0;
  /// Since the Unix epoch for cameras; a replay keeps its source's own clock.
  std::int64_t capture_time_ns = 0;
  std::uint32_t exposure_ns = 0;  ///< 0: unknown
  std::uint16_t width_px = 0;     ///< of each image
  std::uint16_t height_px = 0;
  std::uint32_t jpeg_crc = 0;  ///< crc32() of `jpeg`, computed once, where the frame was encoded
  std::vector<std::uint8_t> jpeg;  ///< stereo: the left image's, then the right one's
  std::uint32_t left_bytes = 0;    ///< of `jpeg`; 0 or all of them: there is no right image
  std::uint8_t quality = 0;  ///< JPEG's, 1..kMaxQuality; 0: unknown, as of a camera's own JPEG
  /// The size and the crc32() of the JPEG that `jpeg` was made from, with fewer bytes and at
  /// `quality`; 0: `jpeg` is the one that was encoded.
  std::uint32_t whole_bytes = 0;
  std::uint32_t whole_crc = 0;

  bool is_reduced() const { return whole_bytes > 0; }
  bool is_stereo() const { return left_bytes > 0 && left_bytes < jpeg.size(); }
  std::span<const std::uint8_t> left() const {
    return std::span(jpeg).first(is_stereo() ? left_bytes : jpeg.size());
  }
  /// Empty if there is none.
  std::span<const std::uint8_t> right() const { return std::span(jpeg).subspan(left().size()); }
};

using FramePtr = std::shared_ptr<const EncodedFrame>;

}  // namespace orbbuf
