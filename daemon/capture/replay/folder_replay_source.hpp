// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/capture/frame_source.hpp"
#include "daemon/capture/replay/times_file.hpp"
#include "daemon/capture/source_settings.hpp"

namespace orbbuf {

struct ImageFolder {
  std::filesystem::path path;
  std::vector<std::string> names;  ///< in order
};

/// The images of a folder, ordered by name, where runs of digits count as numbers: png, jpg, jpeg
/// and pgm; other files are ignored. Times come from a times.txt in the folder or beside it, or
/// from the file that EuRoC, TUM RGB-D and KITTI raw have beside it (times_file.hpp), else from
/// settings.fps.
///
/// With a second folder of as many images the frames are stereo, the first with the first and so
/// on, whatever their names; times are the left images'.
///
/// JPEG files are passed on unread, as kJpeg. The others are decoded, to gray or, if
/// settings.color, to colour. White is the format's largest value, of a PGM its maxval, whatever
/// the image's is. An image that is unreadable or cut short is a frame with a defect. At its
/// reader's pace; ReplaySource gives it the camera's.
class FolderReplaySource : public FrameSource {
 public:
  /// settings.path and, if not empty, path_right: the images' folder, or the data set that holds
  /// them, as `images` or where its layout has those of the left camera. Reads all names and times;
  /// throws std::runtime_error if there are no images, not as many right ones as left ones, or
  /// their times cannot be used.
  explicit FolderReplaySource(const SourceSettings& settings);

  std::optional<RawFrame> next(std::stop_token stop) override;
  bool is_live() const override { return false; }
  std::string description() const override;

 private:
  double fps_;
  bool is_color_;
  ImageFolder left_;
  std::optional<ImageFolder> right_;
  std::filesystem::path times_file_;  ///< empty: times by fps_
  std::string_view layout_;           ///< of it
  std::vector<ImageTime> times_;
  std::size_t next_ = 0;
};

}  // namespace orbbuf
