// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ros_messages.h>  // made of ros_messages.idl by idlc

#include <cstdint>

namespace orbbuf {

/// The stamp of a message, in ns of ROS 2's clock.
inline std::int64_t time_ns_of(const std_msgs_msg_dds__Header_& header) {
  return header.stamp.sec * 1'000'000'000LL + header.stamp.nanosec;
}

}  // namespace orbbuf
