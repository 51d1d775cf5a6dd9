// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string_view>
#include <vector>

#include "server/dataset/calibration.hpp"

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

/// Which camera of a stereo pair a calibration is for; kLeft is also the only one.
enum class Side : std::uint8_t { kLeft, kRight };

/// False for a lens that no distortion model of Foxglove describes: DSO's FOV.
bool can_express(const Calibration& camera);

/// foxglove.CameraCalibration. The right camera is the left one moved along x by the baseline.
/// Requires can_express(camera).
std::vector<std::uint8_t> camera_calibration(std::int64_t time_ns, std::string_view frame_id,
                                             const Calibration& camera, Side side);

}  // namespace orbbuf::foxglove
