// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "server/dataset/dataset.hpp"
#include "server/recording/recorded_session.hpp"

namespace orbbuf {

/// Forms in which SLAM programs and their tools expect a sequence; docs/datasets.md has a table.
enum class Layout : std::uint8_t {
  kTumMono,  ///< TUM monoVO: what SessionFiles writes, the drop record included
  kEuroc,    ///< EuRoC, ASL: mav0/cam0/data/NS.jpg, data.csv, sensor.yaml; cam1 for right images
  kKitti,    ///< KITTI odometry: image_0/000000.jpg, numbered from 0, times.txt, calib.txt; image_1
  kTumRgbd,  ///< TUM RGB-D: rgb/SECONDS.jpg, rgb.txt
};

/// On the command line, in the order of Layout.
inline constexpr std::array<std::string_view, 4> kLayouts = {"tum-mono", "euroc", "kitti",
                                                             "tum-rgbd"};

/// Plans it, touching no file. extension: of the images, without the dot. Requires frames in order
/// (problems_of_order() is empty).
Dataset lay_out(const RecordedSession& session, Layout layout, std::string_view extension);

}  // namespace orbbuf
