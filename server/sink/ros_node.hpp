// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace orbbuf {

/// What a sensor_msgs/CameraInfo says of a camera.
struct RosCamera {
  std::uint32_t width_px = 0;
  std::uint32_t height_px = 0;
  std::string distortion_model;
  std::vector<double> distortion;
  std::array<double, 9> k{};
  std::array<double, 12> p{};
};

/// roscpp as this process uses it. A file of its own, and in C++17, since ROS 1's messages do not
/// compile as C++20. At most one in a process, ever; one thread.
class RosNode {
 public:
  RosNode();
  /// Topics and queues end with it.
  ~RosNode();
  RosNode(const RosNode&) = delete;
  RosNode& operator=(const RosNode&) = delete;

  /// An image to BASE/image_raw/compressed and, unless `camera` is null, BASE/camera_info. Nothing
  /// happens while there is no master, which is looked for at most once a second. May block for a
  /// second if the master goes in the middle of it.
  void publish(const std::string& base, std::int64_t time_ns, const std::uint8_t* jpeg,
               std::size_t bytes, const RosCamera* camera);

 private:
  class Topics;

  bool is_connected();

  std::unique_ptr<Topics> topics_;  // once there has been a master
  bool is_initialised_ = false;
  bool is_waiting_ = false;
  std::int64_t next_look_ns_ = 0;  // by the steady clock
};

}  // namespace orbbuf
