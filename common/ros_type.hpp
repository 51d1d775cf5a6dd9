// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace orbbuf {

/// A type of DDS, `sensor_msgs::msg::dds_::Imu_`, as ROS 2 has it: `sensor_msgs/msg/Imu`.
inline std::string ros_type(std::string_view dds_type) {
  constexpr std::string_view kModule = "::dds_::";
  std::string type(dds_type);
  if (const auto at = type.find(kModule); at != std::string::npos && type.ends_with('_')) {
    type.replace(at, kModule.size(), "/");
    type.pop_back();
  }
  if (const auto at = type.find("::"); at != std::string::npos) type.replace(at, 2, "/");
  return type;
}

}  // namespace orbbuf
