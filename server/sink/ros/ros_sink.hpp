// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "server/session/session_info.hpp"
#include "server/sink/frame_sink.hpp"

namespace orbbuf {

struct RosSettings {
  bool enabled = false;              ///< requires ORBBUF_ROS
  std::string frame_id = "{robot}";  ///< of all messages; see ros_frame_id()
  std::uint32_t queue = 100;         ///< messages of a topic that may wait for each subscriber
  double pace = 2;  ///< frames of a burst: at most this many times the camera's rate
  std::chrono::nanoseconds wait_for_subscriber = std::chrono::seconds{1};

  friend bool operator==(const RosSettings&, const RosSettings&) = default;
};

/// A sink that publishes a session's frames to ROS 1, under their capture times:
///
///   /ROBOT/image_raw             sensor_msgs/Image, mono8, decoded while there is a subscriber
///   /ROBOT/image_raw/compressed  sensor_msgs/CompressedImage, the frames byte for byte
///   /ROBOT/camera_info           sensor_msgs/CameraInfo with each, if the robot sent a camera.txt
///                                with another lens than FOV
///   /ROBOT/left/..., /ROBOT/right/...   the same of stereo frames
///   /ROBOT/NAME                  sensor_msgs/Imu, the samples of the sensor NAME, before the first
///                                newer frame
///
/// which is what image_transport looks for. ROBOT is what ros_name() makes of the robot's id. Both
/// images of a pair are decoded before either is published. The topics stay until this process
/// ends, so that a subscriber of one session has the next from its first frame on.
///
/// The first frames of a session wait until each camera has a subscriber of its images, up to
/// `wait_for_subscriber`. Frames that arrive in a burst are spread as Pace does it, unless 32 MiB
/// wait.
///
/// It never pauses the stream: a frame is taken at once. Up to 64 MiB of all sessions wait. Given
/// up are frames that find these full, that come while there is no master, for which it looks every
/// second, that wait when the server stops, and those that roscpp gives up because a subscriber has
/// `queue` messages waiting. All are in lost(), and logged. One thread, `ros`, of all the sinks
/// calls roscpp, until end_ros(); none of roscpp's own threads calls anything of ours but a
/// counter. Drop records are not published.
std::shared_ptr<FrameSink> make_ros_sink(boost::asio::io_context& main, const SessionInfo& info,
                                         const RosSettings& settings);

/// The topics end; waits for that, up to 1 s. On `main`, after the last sink's last frame. False:
/// roscpp still waits for a master that takes a connection and says nothing, without limit; then
/// the process can only end without its destructors.
bool end_ros();

}  // namespace orbbuf
