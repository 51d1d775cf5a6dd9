// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "server/session/session_reader.hpp"

namespace orbbuf {

/// What a folder in some layout consists of; paths are relative to it.
struct Dataset {
  struct Image {
    std::string from;  ///< in the session's folder
    std::string to;
  };
  struct Text {
    std::string to;
    std::string content;
  };
  std::vector<Image> images;
  std::vector<Text> texts;
  std::vector<std::string> notes;  ///< what the layout cannot say of a session, one line each
};

bool is_stereo(const RecordedSession& session);

/// Add to `dataset` what the calibration says, in the layout's own form, and a note for what that
/// form cannot say.

/// EuRoC's sensor.yaml: every model, FOV in the form of Kalibr's `fov`.
void add_euroc_calibration(const RecordedSession& session, Dataset& dataset);
/// KITTI's calib.txt, of a camera without lens distortion only.
void add_kitti_camera(const RecordedSession& session, Dataset& dataset);

/// Forms in which SLAM programs and their tools expect a sequence; docs/datasets.md has a table.
enum class Layout : std::uint8_t {
  kTumMono,  ///< TUM monoVO: the session's own, the drop record included
  kEuroc,    ///< EuRoC, ASL: mav0/cam0/data/NS.jpg, data.csv, sensor.yaml; cam1 for right images
  kKitti,    ///< KITTI odometry: image_0/000000.jpg, numbered from 0, times.txt, calib.txt; image_1
  kTumRgbd,  ///< TUM RGB-D: rgb/SECONDS.jpg, rgb.txt
  kMcap,     ///< one file: mcap::Recording
};

/// On the command line, in the order of Layout.
inline constexpr std::array<std::string_view, 5> kLayouts = {"tum-mono", "euroc", "kitti",
                                                             "tum-rgbd", "mcap"};

/// Plans it, touching no file; not kMcap. extension: of the images, without the dot. Requires times
/// that increase.
Dataset lay_out(const RecordedSession& session, Layout layout, std::string_view extension);

}  // namespace orbbuf
