// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "common/dds/dds_participant.hpp"
#include "common/error.hpp"
#include "common/jpeg.hpp"
#include "common/sample.hpp"
#include "server/calibration/camera_info.hpp"

namespace orbbuf {

/// The ROS 2 topics of one camera:
///
///   BASE/image_raw/compressed  sensor_msgs/msg/CompressedImage
///   BASE/image_raw             sensor_msgs/msg/Image, mono8
///   BASE/camera_info           sensor_msgs/msg/CameraInfo, latched: a reader that asks for
///                              durability `transient local` gets the last one, too
///
/// All are reliable, and keep the last 256 messages (raw: 16) for readers that lack them. No reader
/// holds up a call, or another reader: one that is slower misses what is older.
/// Thread-bound: one object per thread; it must not outlive the participant.
class DdsCamera {
 public:
  /// base: as ROS 2 writes it, without a first slash: `turtlebot1/left`. Throws std::runtime_error.
  DdsCamera(const DdsParticipant& participant, const std::string& base, std::string frame_id);
  ~DdsCamera();
  DdsCamera(const DdsCamera&) = delete;
  DdsCamera& operator=(const DdsCamera&) = delete;

  /// An image and, unless `camera` is null, its camera_info with the same stamp. After an error
  /// readers may have one of the two.
  std::optional<Error> publish(std::int64_t time_ns, std::span<const std::uint8_t> jpeg,
                               const CameraInfo* camera);
  std::optional<Error> publish_raw(std::int64_t time_ns, const GrayImage& image);
  bool has_raw_reader() const;

 private:
  const std::string frame_id_;
  int publisher_;  // owns the writers
  int compressed_ = 0;
  int raw_ = 0;
  int info_ = 0;
};

/// The ROS 2 topic of an inertial sensor, sensor_msgs/msg/Imu: without orientation, which the first
/// element of its covariance says, and with unknown covariances. Reliable; keeps the last minute at
/// 1 kHz. Otherwise as DdsCamera.
class DdsImu {
 public:
  /// topic: as ROS 2 writes it, without a first slash. Throws std::runtime_error.
  DdsImu(const DdsParticipant& participant, const std::string& topic, std::string frame_id);
  ~DdsImu();
  DdsImu(const DdsImu&) = delete;
  DdsImu& operator=(const DdsImu&) = delete;

  std::optional<Error> publish(const Sample& sample);

 private:
  const std::string frame_id_;
  int publisher_;  // owns the writer
  int writer_ = 0;
};

}  // namespace orbbuf
