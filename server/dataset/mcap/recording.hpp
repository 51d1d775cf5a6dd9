// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/calibration/camera_info.hpp"
#include "common/drop_record.hpp"
#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/sample.hpp"
#include "server/dataset/mcap/file.hpp"
#include "server/session/records.hpp"

namespace orbbuf::mcap {

/// A session, or a part of one, as an MCAP file (https://mcap.dev), which Foxglove and mcap's own
/// tools open:
///
///   /ROBOT/image              foxglove.CompressedImage, the frames byte for byte
///   /ROBOT/calibration        foxglove.CameraCalibration, one with each frame, if the robot sent a
///                             camera.txt that it can express
///   /ROBOT/{left,right}/...   the same of stereo frames; the right calibration needs the baseline
///   /ROBOT/drops              orbbuf.Drop, JSON: the frames that will not come
///   /ROBOT/quality            orbbuf.Quality, JSON: one with each frame of which it is known
///   /ROBOT/NAME               orbbuf.Imu, JSON: the samples of the stream NAME
///
/// A session with topics of ROS 2 has MCAP's profile `ros2` instead, which allows nothing else, so
/// that `ros2 bag play` plays it, and Foxglove shows it, too:
///
///   /odom, ...                        the robot's own topics, under its names, as they were on DDS
///   /ROBOT/image_raw/compressed       sensor_msgs/msg/CompressedImage, the frames byte for byte
///   /ROBOT/camera_info                sensor_msgs/msg/CameraInfo
///   /ROBOT/{left,right}/...           the same of stereo frames
///   /ROBOT/NAME                       sensor_msgs/msg/Imu, without orientation
///
/// The log time of each is the time of capture, so that a player shows what the camera saw when; a
/// time before 1970 becomes 0 there. The sequence of a message is the number of the frame or the
/// sample, modulo 2^32.
/// Blocking; reentrant.
class Recording {
 public:
  /// Makes the file, in place of one that is there.
  static Result<Recording> create(const std::filesystem::path& path, const SessionInfo& info);

  /// True: about a megabyte was written.
  Result<bool> add(const EncodedFrame& frame);
  /// A message for each frame of the range.
  Result<bool> add(const DropRecord& range);
  /// A message for each sample or message of a topic, if it is a stream of such.
  Result<bool> add(const RecordedItems& items);
  Result<bool> add(wire::StreamId stream, std::uint64_t number, const Sample& sample);
  /// Why there is no calibration in it, though the session has one; empty: there is.
  const std::string& problem() const { return cameras_.problem; }

  /// Makes the file complete. clock_offset_ns: if it is not 0, a metadata record `orbbuf.clock`
  /// says that it is to be added to all times (`offset_ns`).
  std::optional<Error> finish(std::int64_t clock_offset_ns);

 private:
  Recording(File file, const SessionInfo& info);

  Result<bool> add(std::uint64_t number, const TopicMessage& message, std::int64_t time_ns);
  Result<bool> add(std::uint16_t channel, Sequence sequence, std::int64_t time_ns,
                   std::span<const std::uint8_t> data);
  std::string name_of(std::uint16_t channel) const;
  std::string frame_id(std::uint16_t channel) const;
  std::uint16_t ros_schema(std::string_view type);

  File file_;
  const bool is_of_ros_;
  const std::string robot_id_;  // for ROS 2, as it may be there
  const std::vector<wire::StreamDeclaration> streams_;
  const CalibratedCameras cameras_;
  std::vector<std::string> ros_types_;                       // those with a schema
  std::vector<std::pair<std::string, std::string>> topics_;  // with their types
};

}  // namespace orbbuf::mcap
