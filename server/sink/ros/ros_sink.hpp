// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <memory>
#include <string_view>

#include "server/recording/session_info.hpp"
#include "server/sink/frame_sink.hpp"

namespace orbbuf {

/// A sink that publishes a session's frames to ROS 1, under their capture times:
///
///   /ROBOT/image_raw/compressed  sensor_msgs/CompressedImage, the frames byte for byte
///   /ROBOT/camera_info           sensor_msgs/CameraInfo with each, if the robot sent a camera.txt
///                                with another lens than FOV
///   /ROBOT/left/..., /ROBOT/right/...   the same of stereo frames
///
/// which is what image_transport looks for; what else than a letter, a digit or _ stands in a
/// robot's id becomes _, and ros_ goes before a digit. The topics stay until this process ends, so
/// that a subscriber of one session has the next from its first frame on.
///
/// `frame_id`, as ros_frame_id() takes it, is of all messages.
///
/// It never pauses the stream: a frame is taken at once. Frames are given up while there is no
/// master, for which it looks every second; of those that come while roscpp waits for one that does
/// not answer, the first 64 MiB of all sessions wait as well and the others are given up. These are
/// in lost(), and logged. roscpp itself gives up the oldest of 100 that wait for a slow subscriber,
/// and does not say so. All calls of roscpp are made on one thread,
/// `ros`, of all the sinks there are, but for roscpp's own threads, none of which calls anything of
/// ours. Drop records are not published.
std::shared_ptr<FrameSink> make_ros_sink(boost::asio::io_context& main, const SessionInfo& info,
                                         std::string_view frame_id);

/// The topics end; waits for that, up to 1 s. On `main`, after the last sink's last frame. False:
/// roscpp still waits for a master that takes a connection and says nothing, without limit; then
/// the process can only end without its destructors.
bool end_ros();

}  // namespace orbbuf
