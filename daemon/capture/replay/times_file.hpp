// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace orbbuf {

/// When an image was taken.
struct ImageTime {
  std::int64_t capture_time_ns = 0;
  std::uint32_t exposure_ns = 0;  ///< 0: unknown

  friend bool operator==(const ImageTime&, const ImageTime&) = default;
};

/// Of all images of a folder, in their order.
struct ImageTimes {
  std::string_view layout;  ///< what data set's form the file has, for people
  std::vector<ImageTime> times;
};

/// Reads a data set's file of times: the time of each of `names`, the file names of the images in
/// their order. Blank lines and what follows a '#' do not count; every other line has the same
/// number of fields, and these decide for the file as a whole which of the usual forms it is in:
///
///     1 field               TIME                 KITTI odometry: line i is image i, as many lines
///                                                as images
///     2, the first a date   DATE TIME_OF_DAY     KITTI raw: the same. 2011-09-26 and
///                                                13:02:25.964389445, taken as UTC
///     2 of a .csv           TIME_NS,NAME         EuRoC
///     2, the second never   TIME NAME            TUM RGB-D: NAME is the image's file name; folders
///       a number                                 before it are ignored
///     2, the second always  ID TIME              TUM monoVO
///       a number
///     3 fields              ID TIME EXPOSURE_MS  TUM monoVO
///
/// TIME is in seconds. ID is the number that the image's name consists of (00042.png: 42) if all
/// names are numbers; otherwise its place among the images, from 0. Lines of images that are not
/// there are ignored, but for the first two forms.
/// Throws std::runtime_error naming file, line and reason: anything else, an image without a line,
/// two lines for one image, times that do not strictly increase from image to image.
ImageTimes read_times_file(const std::filesystem::path& file,
                           const std::vector<std::string>& names);

/// `text` times 10^`digits`, exactly, what is still behind the point cut off: "31463.291" with 9 is
/// 31463291000000. Plain decimals and, as KITTI writes them, 1.039360e-01. Nothing if it is not a
/// number from 0 to 2^63 - 1.
std::optional<std::int64_t> parse_decimal(std::string_view text, int digits);

}  // namespace orbbuf
