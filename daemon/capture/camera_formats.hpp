// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/error.hpp"

namespace orbbuf {

/// The pixel formats that are read from a V4L2 camera, as the configuration names them, the one to
/// be preferred first: in GREY, NV12 and YUV420 the luma that a gray JPEG is made of comes first,
/// in one piece; in YUYV and UYVY it is every other byte; from BGR24 and RGB24 it is calculated.
/// MJPG costs nothing, but its quality is the camera's, and gray is not to be had.
enum class CameraFormat { kGrey, kNv12, kYuv420, kYuyv, kUyvy, kBgr24, kRgb24, kMjpg };

inline constexpr std::array<std::string_view, 8> kCameraFormats = {
    "GREY", "NV12", "YUV420", "YUYV", "UYVY", "BGR24", "RGB24", "MJPG"};

inline std::string_view to_string(CameraFormat format) {
  return kCameraFormats.at(static_cast<std::size_t>(format));
}

/// What a driver offers in one format. A driver need not say: no sizes, or no rates, is unknown.
struct CameraSize {
  int min_width_px = 0;
  int min_height_px = 0;
  int max_width_px = 0;  ///< more than the least: any size between
  int max_height_px = 0;
  std::vector<double> rates;  ///< frames per second, the highest first

  bool holds(int width_px, int height_px) const {
    return width_px >= min_width_px && width_px <= max_width_px && height_px >= min_height_px &&
           height_px <= max_height_px;
  }
};

struct CameraOffer {
  std::string fourcc;  ///< four characters, the driver's name for the format
  std::vector<CameraSize> sizes;
};

/// `YUYV 640x480 (30, 15 fps), 1280x720 (10 fps); MJPG ...`, for errors and lists.
std::string describe(std::span<const CameraOffer> offers);

/// The sizes alone: `640x480 (30, 15 fps), 1280x720 (10 fps)`.
std::string describe_sizes(const CameraOffer& offer);

/// A line for each format that is read, with its sizes, and one that names the others.
std::string list_offers(std::span<const CameraOffer> offers);

/// The driver's four characters for `format`, and back; nothing for a format that is not read.
std::string_view fourcc_of(CameraFormat format);
std::optional<CameraFormat> format_of(std::string_view fourcc);

/// NV12, YUV420, YUYV and UYVY.
bool is_yuv(CameraFormat format);

/// Whether it has colours.
inline bool gives_color(CameraFormat format) { return format != CameraFormat::kGrey; }

struct CameraRequest {
  std::string_view format = "auto";  ///< "auto" or one of kCameraFormats
  int width_px = 0;
  int height_px = 0;
  double fps = 0;
  bool color = false;
};

/// The format to capture in: of the requested formats that offer the size, the first in the order
/// of CameraFormat that reaches the rate, else the fastest. In colour, GREY is left out. So "auto"
/// is MJPG only where nothing else is as fast: else quality and colour are those of `[jpeg]`, and a
/// gray image is smaller on the link. Fails with a list of the offers.
Result<CameraFormat> choose_format(std::span<const CameraOffer> offers,
                                   const CameraRequest& request);

}  // namespace orbbuf
