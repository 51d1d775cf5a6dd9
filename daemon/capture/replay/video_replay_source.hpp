// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <opencv2/videoio.hpp>

#include "daemon/capture/frame_source.hpp"
#include "daemon/capture/source_settings.hpp"

namespace orbbuf {

/// The frames of a video file, in gray or, if settings.color, in colour. Times count from 0 at the
/// rate that the file states, or at settings.fps if it states none. At its reader's pace;
/// ReplaySource gives it the camera's.
class VideoReplaySource : public FrameSource {
 public:
  /// settings.path: the file. Throws std::runtime_error unless a first frame comes out of it.
  explicit VideoReplaySource(const SourceSettings& settings);

  /// A frame that cannot be decoded, or is missing in a video of a steady rate, comes with a
  /// defect. Throws std::runtime_error at the end of a video that is shorter than it states; one
  /// frame with a defect before stands for the missing end.
  std::optional<RawFrame> next(std::stop_token stop) override;
  bool is_live() const override { return false; }
  std::string description() const override;

 private:
  void decode_next();
  void read_no_fields();
  void note_position();
  std::int64_t missing_at_end();
  bool is_steady() const;
  RawFrame missing_frame();

  std::filesystem::path path_;
  bool is_color_;
  double fps_;
  cv::VideoCapture video_;
  cv::Mat decoded_;  ///< what next() hands out, as it came; empty at the end
  std::int64_t index_ = 0;
  std::int64_t missing_ = 0;  ///< frames between the last one and decoded_
  std::int64_t decoded_count_ = 0;
  double stated_seconds_ = 0;    ///< of the whole video
  double position_seconds_ = 0;  ///< of decoded_, or of the last frame
  bool has_steady_rate_ = true;  ///< so far the frames come at the stated rate
  bool breaks_off_ = false;
};

}  // namespace orbbuf
