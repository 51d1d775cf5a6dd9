// SPDX-License-Identifier: Apache-2.0
#pragma once

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
  double fps = 0;                ///< 0: the driver does not say
};

/// The image in a driver's buffer, of which `data` was filled, in memory of its own: one pass, in
/// which luma is picked out of YUYV and UYVY, only the luma of NV12 and YUV420 is taken, and RGB24
/// becomes kBgr24. So the driver has its buffer back at once, however long the frame is kept. About
/// 0.01 ms for 640x480, 0.2 ms for RGB24. Data that do not hold the image make a frame with a
/// defect. Sets no time.
RawFrame unpack(const CameraMode& mode, std::span<const std::uint8_t> data);

}  // namespace orbbuf
