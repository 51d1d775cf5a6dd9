// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ros_messages.h>  // made of ros_messages.idl by idlc

#include <cstdint>
#include <cstring>
#include <optional>
#include <span>

namespace orbbuf {

/// The stamp of a message, in ns of ROS 2's clock.
inline std::int64_t time_ns_of(const std_msgs_msg_dds__Header_& header) {
  return header.stamp.sec * 1'000'000'000LL + header.stamp.nanosec;
}

/// The same of a message's bytes on DDS, whose type begins with a header; nothing: it is too short,
/// or big-endian.
inline std::optional<std::int64_t> header_time_ns(std::span<const std::uint8_t> cdr) {
  constexpr std::size_t kStamp = 4;
  std_msgs_msg_dds__Header_ header{};
  auto& [sec, nanosec] = header.stamp;
  const bool is_little_endian = cdr.size() > 1 && cdr[1] % 2 == 1;
  if (!is_little_endian || cdr.size() < kStamp + sizeof sec + sizeof nanosec) return std::nullopt;
  std::memcpy(&sec, cdr.data() + kStamp, sizeof sec);
  std::memcpy(&nanosec, cdr.data() + kStamp + sizeof sec, sizeof nanosec);
  return time_ns_of(header);
}

}  // namespace orbbuf
