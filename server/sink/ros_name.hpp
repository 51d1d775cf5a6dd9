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

/// `pattern` with `name` in place of the first {robot}.
inline std::string ros_frame_id(std::string_view pattern, std::string_view name) {
  constexpr std::string_view kRobot = "{robot}";
  std::string id(pattern);
  const auto at = id.find(kRobot);
  if (at != std::string::npos) id.replace(at, kRobot.size(), name);
  return id;
}

}  // namespace orbbuf
