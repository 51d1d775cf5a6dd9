// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "daemon/capture/crop.hpp"

namespace orbbuf {

/// `[source]` of orbbufd.toml.
struct SourceSettings {
  std::string kind = "generated";      ///< one of kSourceKinds
  std::filesystem::path path;          ///< folder: the images; video: the file
  std::filesystem::path path_right;    ///< folder: the right images; empty: not stereo
  std::string device = "/dev/video0";  ///< v4l2: the camera's node
  std::string device_right;            ///< v4l2: the right camera's node; empty: not stereo
  std::string camera = "0";            ///< libcamera: its id, or its place in libcamera's list
  std::string topic;                   ///< ros2: the images, `/camera/image_raw/compressed`
  std::string topic_right;             ///< ros2: the right images; empty: not stereo
  bool is_side_by_side = false;        ///< every image is a left and a right one, side by side
  std::string format = "auto";  ///< cameras: one of kCameraFormats, or "auto" (camera_formats.hpp)
  std::map<std::string, double>
      controls;              ///< cameras: by name (v4l2_controls.hpp, libcamera_controls.hpp)
  std::optional<Crop> crop;  ///< cameras: the part of the sensor to use; unset: all of it
  double fps = 25.0;  ///< frames per second: a camera's, or where files have no times of their own
  bool realtime = true;    ///< pace frames by their capture times; else as fast as they are taken
  bool loop = false;       ///< begin again at the end, capture times going on
  std::uint64_t seed = 1;  ///< generated: same seed, same frames
  int width_px = 640;      ///< generated, cameras
  int height_px = 480;     ///< generated, cameras
  std::int64_t frames = 500;  ///< generated: how many
  bool color = false;         ///< `[jpeg] color`: whether images are read in colour
};

/// Every kind of source, by its name in the configuration.
inline constexpr std::array<std::string_view, 6> kSourceKinds = {"generated", "folder",    "video",
                                                                 "v4l2",      "libcamera", "ros2"};

}  // namespace orbbuf
