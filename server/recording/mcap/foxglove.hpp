// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "server/calibration/camera_info.hpp"

/// The messages of Foxglove's schemas that a recording is made of, as protobuf writes them.
namespace orbbuf::foxglove {

/// A schema's name and its FileDescriptorSet, whole with what it imports.
struct Schema {
  std::string_view name;
  std::vector<std::uint8_t> descriptors;
};
Schema compressed_image_schema();
Schema camera_calibration_schema();

/// foxglove.CompressedImage.
std::vector<std::uint8_t> compressed_image(std::int64_t time_ns, std::string_view frame_id,
                                           std::span<const std::uint8_t> jpeg);

/// foxglove.CameraCalibration.
std::vector<std::uint8_t> camera_calibration(std::int64_t time_ns, std::string_view frame_id,
                                             const CameraInfo& camera);

}  // namespace orbbuf::foxglove
