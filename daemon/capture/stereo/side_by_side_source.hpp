// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "common/jpeg.hpp"
#include "daemon/capture/frame_source.hpp"

namespace orbbuf {

/// Stereo frames of a source whose images hold the left and the right one side by side.
///
/// Gray and BGR pixels are not copied: both halves lie in the memory of the whole. The halves of a
/// kYuv420 image are copies. A JPEG is split without decoding its pixels, on `capture`
/// (JpegCodec::halve()). An image that has no two equal halves is a frame with a defect.
class SideBySideSource : public FrameSource {
 public:
  explicit SideBySideSource(std::unique_ptr<FrameSource> source);

  std::optional<RawFrame> next(std::stop_token stop) override;
  bool is_live() const override { return source_->is_live(); }
  std::string description() const override;

 private:
  std::string split_jpeg(RawFrame& frame);

  const std::unique_ptr<FrameSource> source_;
  JpegCodec codec_{"source"};
};

}  // namespace orbbuf
