// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cctype>
#include <string>
#include <string_view>

namespace orbbuf {

/// A robot's id as the first part of a topic's name in ROS 1 and ROS 2: `_` stands for each
/// character that is neither a letter nor a digit, and `ros_` goes before an id that does not begin
/// with a letter. Two ids may have the same name. Requires an id that is not empty.
inline std::string ros_name(const std::string& robot_id) {
  const bool is_letter_first = std::isalpha(static_cast<unsigned char>(robot_id.front())) != 0;
  std::string name = is_letter_first ? robot_id : "ros_" + robot_id;
  std::ranges::replace_if(
      name, [](unsigned char c) { return std::isalnum(c) == 0; }, '_');
  return name;
}

/// Whether ROS 2 allows it as the whole name of a topic, or as what several have in front:
/// `/front/camera`.
inline bool is_ros_topic(std::string_view name) {
  char before = 0;
  for (const char c : name) {
    const bool is_letter = std::isalpha(static_cast<unsigned char>(c)) != 0 || c == '_';
    const bool is_digit = std::isdigit(static_cast<unsigned char>(c)) != 0;
    const bool fits = before == 0     ? c == '/'
                      : before == '/' ? is_letter
                                      : c == '/' || is_letter || is_digit;
    if (!fits) return false;
    before = c;
  }
  return name.size() > 1 && before != '/';
}

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

/// `pattern` with `name` in place of the first {robot}.
inline std::string ros_frame_id(std::string_view pattern, std::string_view name) {
  constexpr std::string_view kRobot = "{robot}";
  std::string id(pattern);
  const auto at = id.find(kRobot);
  if (at != std::string::npos) id.replace(at, kRobot.size(), name);
  return id;
}

}  // namespace orbbuf
