// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/jpeg.hpp"
#include "daemon/capture/frame_source.hpp"

namespace orbbuf {

/// `[jpeg]` of orbbufd.toml.
struct JpegSettings {
  int quality = 80;    ///< 1..100; the paper's value (Sec. IV-A)
  bool color = false;  ///< false: grayscale; true: 4:2:0 colour
};

/// Encodes a RawFrame as an EncodedFrame. Checks that a frame which is JPEG already is complete,
/// and passes it on unchanged, but for what readers may not expect: its head becomes a standard one
/// (standard_head.hpp), it is cut behind its end marker, and gets one if it has all rows but none.
/// Thread-bound.
class JpegEncoder {
 public:
  explicit JpegEncoder(const JpegSettings& settings);

  /// `sequence` is the frame's number. Fails for a frame with a defect, a truncated JPEG, or a size
  /// over 65535 pixels either way; of a stereo frame, for either image, and if the two differ in
  /// size. Does not keep the raw frame.
  /// The frame's quality is that of the settings, and 0 where the source's own JPEG is passed on.
  Result<EncodedFrame> encode(const RawFrame& raw, Sequence sequence);

  /// 1..100, for the frames from now on.
  void set_quality(int quality) { settings_.quality = quality; }

 private:
  struct Image {
    int width_px = 0;
    int height_px = 0;
    std::vector<std::uint8_t> jpeg;
  };
  Result<Image> encode_image(const RawFrame& raw);

  JpegSettings settings_;
  JpegCodec codec_{"source"};
};

}  // namespace orbbuf
