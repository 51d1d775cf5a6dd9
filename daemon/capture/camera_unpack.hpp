// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "daemon/capture/camera_formats.hpp"
#include "daemon/capture/frame_source.hpp"

namespace orbbuf {

/// The format, size and rate that the driver has accepted.
struct CameraMode {
  CameraFormat format = CameraFormat::kGrey;
  int width_px = 0;
  int height_px = 0;
  std::size_t stride_bytes = 0;  ///< from row to row of the first plane; MJPG: unused
  bool color = false;            ///< false: of the YUV formats the luma alone is taken
  double fps = 0;                ///< 0: the driver does not say
};

/// The second and third plane of an image; empty: they follow the first, without a gap.
using ChromaPlanes = std::array<std::span<const std::uint8_t>, 2>;

/// The image in a driver's buffer, of which `data` was filled, in memory of its own, so that the
/// driver has its buffer back at once, however long the frame is kept. The YUV formats become
/// kGray8 or, in colour, kYuv420 (of YUYV and UYVY the mean of two rows' chroma); their values are
/// not scaled, whatever range the camera uses. RGB24 becomes kBgr24. About 0.01 ms for the luma of
/// 640x480, 0.2 ms in colour. Data that do not hold the image make a frame with a defect. Sets no
/// time.
RawFrame unpack(const CameraMode& mode, std::span<const std::uint8_t> data,
                const ChromaPlanes& chroma = {});

}  // namespace orbbuf
