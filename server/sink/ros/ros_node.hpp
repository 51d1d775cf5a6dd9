// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "common/calibration/camera_info.hpp"

namespace orbbuf {

/// An image to publish; owns nothing.
struct RosImage {
  std::int64_t time_ns = 0;
  const std::uint8_t* jpeg = nullptr;
  std::size_t jpeg_bytes = 0;
  const std::uint8_t* pixels = nullptr;  ///< gray, rows without padding; null: not decoded
  std::uint32_t width_px = 0;            ///< of `pixels`
  std::uint32_t height_px = 0;
  const CameraInfo* camera = nullptr;  ///< null: unknown
};

/// A sample of an inertial sensor, as sensor_msgs/Imu has it.
struct RosImu {
  std::int64_t time_ns = 0;
  std::array<double, 3> angular_velocity{};
  std::array<double, 3> linear_acceleration{};
};

/// roscpp as this process uses it. A file of its own, and in C++17, since ROS 1's messages do not
/// compile as C++20. At most one in a process, ever; one thread at a time.
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

  // These require is_connected(), and may block as that does.

  /// Makes the topics BASE/image_raw, BASE/image_raw/compressed and BASE/camera_info, if they are
  /// new. queue: the messages of each that may wait for each subscriber, >= 1.
  void advertise(const std::string& base, std::uint32_t queue);

  // These require advertise(base).

  bool has_image_subscriber(const std::string& base) const;
  bool has_raw_subscriber(const std::string& base) const;

  /// To all three topics of BASE, as far as `image` has something for them. False: a subscriber had
  /// not taken `queue` messages of one, so that roscpp gives up the oldest.
  bool publish(const std::string& base, const std::string& frame_id, const RosImage& image);

  /// To the topic of that name, which is made if it is new; else as publish().
  bool publish(const std::string& topic, const std::string& frame_id, const RosImu& imu);
  void advertise_imu(const std::string& topic);

 private:
  class Topics;

  std::unique_ptr<Topics> topics_;  // once there has been a master
  bool is_initialised_ = false;
  bool is_waiting_ = false;
  std::int64_t next_look_ns_ = 0;  // by the steady clock
};

}  // namespace orbbuf
