// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <filesystem>
#include <memory>
#include <string>

#include "server/session/session_info.hpp"
#include "server/sink/frame_sink.hpp"

namespace orbbuf {

/// Makes this process known to DDS, so that its readers are known before the first session. Throws
/// std::runtime_error. Once, before the first make_dds_sink().
void begin_dds();

struct DdsSettings {
  bool enabled = false;              ///< requires ORBBUF_DDS
  std::string frame_id = "{robot}";  ///< of all messages; see ros_frame_id()
  double pace = 1.2;  ///< frames of a burst: at most this many times the camera's rate

  friend bool operator==(const DdsSettings&, const DdsSettings&) = default;
};

/// What the server has of a session from before this process, or from before the robot came back.
struct DdsBefore {
  std::filesystem::path folder;  ///< empty: the session is not kept
  wire::Position position;
};

/// A sink that publishes a session's frames by DDS as ROS 2 does, under their capture times, to the
/// topics of DdsCamera: /ROBOT/..., or /ROBOT/left/... and /ROBOT/right/... of stereo frames, with
/// the name that ros_name() makes of the robot's id.
/// The samples of a sensor go to /ROBOT/NAME, DdsImu, before the first newer frame; the messages of
/// its own topics to /ROBOT/TOPIC, DdsTopics. What publishers kept for late readers is published
/// again from the session's journal.
/// The topics exist from the session's begin to its end. A calibration with a baseline tells that
/// it is stereo; without one the first frame does, and the topics may change with it.
///
/// Frames and messages that come in a burst are spread, as PacedSession does it. Threads `dds`
/// publish, and decode images for readers of raw ones: four at a time. What finds
/// 64 MiB waiting for it, or what DDS refuses, is given up: counted in lost(), and logged at most
/// every 10 s. Without readers nothing waits and nothing is lost. For 3 s after begin_dds() frames
/// wait, so that readers can find this process. Drop records are not published.
std::shared_ptr<FrameSink> make_dds_sink(boost::asio::io_context& main, const SessionInfo& info,
                                         const DdsSettings& settings, const DdsBefore& before);

/// Publishes what waits, for at most 1 s, counts the rest as lost, and leaves DDS: with a reader
/// that does not answer, some seconds later. On `main`, when no sink is left. Harmless without
/// begin_dds().
void end_dds();

}  // namespace orbbuf
