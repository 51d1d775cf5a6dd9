// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "server/calibration/camera_info.hpp"

namespace orbbuf {

/// roscpp as this process uses it. A file of its own, and in C++17, since ROS 1's messages do not
/// compile as C++20. At most one in a process, ever; one thread.
class RosNode {
 public:
  RosNode();
  ~RosNode();
  RosNode(const RosNode&) = delete;
  RosNode& operator=(const RosNode&) = delete;

  /// Topics and queues end. May wait for the master, without limit if that has stopped.
  void close();

  /// Whether there has been a master, which is looked for at most once a second. May block: for
  /// minutes if the master's host does not answer, without limit if the master has stopped.
  bool is_connected();

  /// An image to BASE/image_raw/compressed and, unless `camera` is null, BASE/camera_info. Requires
  /// is_connected(). May block as that does.
  void publish(const std::string& base, const std::string& frame_id, std::int64_t time_ns,
               const std::uint8_t* jpeg, std::size_t bytes, const CameraInfo* camera);

 private:
  class Topics;

  std::unique_ptr<Topics> topics_;  // once there has been a master
  bool is_initialised_ = false;
  bool is_waiting_ = false;
  std::int64_t next_look_ns_ = 0;  // by the steady clock
};

}  // namespace orbbuf
