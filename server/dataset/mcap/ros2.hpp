// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "common/calibration/camera_info.hpp"
#include "common/sample.hpp"
#include "server/dataset/mcap/record.hpp"

/// Messages of ROS 2 as CDR, and the texts of their types.
namespace orbbuf::mcap::ros2 {

inline constexpr std::string_view kImageType = "sensor_msgs/msg/CompressedImage";
inline constexpr std::string_view kInfoType = "sensor_msgs/msg/CameraInfo";
inline constexpr std::string_view kImuType = "sensor_msgs/msg/Imu";

Bytes compressed_image(std::int64_t time_ns, std::string_view frame_id,
                       std::span<const std::uint8_t> jpeg);
Bytes camera_info(std::int64_t time_ns, std::string_view frame_id, const CameraInfo& camera);
/// Without orientation, as its covariance says.
Bytes imu(const Sample& sample, std::string_view frame_id);

/// The type with those that it is made of, as MCAP's `ros2msg`: for Foxglove, which does not know
/// types by their names. Empty: we do not know it.
std::string definition_of(std::string_view type);

}  // namespace orbbuf::mcap::ros2
