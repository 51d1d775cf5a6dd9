// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/calibration/camera_info.hpp"
#include "common/dds/dds_participant.hpp"
#include "common/dds/raw_topic.hpp"
#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/jpeg.hpp"
#include "common/sample.hpp"

namespace orbbuf {

/// The ROS 2 topics of one camera:
///
///   BASE/image_raw/compressed  sensor_msgs/msg/CompressedImage
///   BASE/image_raw             sensor_msgs/msg/Image, mono8
///   BASE/camera_info           sensor_msgs/msg/CameraInfo, latched: a reader that asks for
///                              durability `transient local` gets the last one, too
///
/// All are reliable, and keep the last `depth` messages (raw: 16 at most) for readers that lack
/// them. No reader holds up a call, or another reader: one that is slower misses what is older.
/// Thread-bound: one object per thread; it must not outlive the participant.
class DdsCamera {
 public:
  static constexpr std::int32_t kDepth = 256;

  /// base: as ROS 2 writes it, without a first slash: `turtlebot1/left`. Throws std::runtime_error.
  DdsCamera(const DdsParticipant& participant, const std::string& base, std::string frame_id,
            std::int32_t depth = kDepth);
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

/// The topics of a camera or a stereo pair: those of DdsCamera, of a pair with BASE/left and
/// BASE/right. Each image goes with its camera_info, if the calibration has it, and its pixels are
/// decoded only while a reader asks for raw images. Otherwise as DdsCamera.
class DdsCameras {
 public:
  /// calibration: as parse_calibration() reads it; empty: none. name: of all this, for the log.
  DdsCameras(const DdsParticipant& participant, std::string base, std::string frame_id,
             std::string_view calibration, std::string name,
             std::int32_t depth = DdsCamera::kDepth);

  /// Makes the topics, of a pair if the calibration has two cameras. Throws std::runtime_error.
  void open() { open(info_.right.has_value()); }
  /// First makes the topics, if there are none, or others. Throws likewise.
  std::optional<Error> publish(const EncodedFrame& frame);

 private:
  void open(bool is_stereo);
  std::optional<Error> publish(DdsCamera& camera, std::int64_t time_ns,
                               std::span<const std::uint8_t> jpeg,
                               const std::optional<CameraInfo>& info);

  const DdsParticipant& participant_;
  const std::string base_;
  const std::string frame_id_;
  const std::string name_;
  const std::int32_t depth_;
  const CalibratedCameras info_;
  JpegCodec codec_;
  std::unique_ptr<DdsCamera> left_;   // or the only one
  std::unique_ptr<DdsCamera> right_;  // null: not stereo
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

/// The robot's own topics, each with the type, the QoS and the user data of its publisher, which
/// has the hash of the type: a writer for each kind of these, and, so that late readers get what
/// each of them kept, for each publisher that keeps messages for late readers. Of each topic up to
/// 64 MiB are kept for readers that are slow. Otherwise as DdsCamera.
class DdsTopics {
 public:
  using Clock = std::chrono::steady_clock;

  /// How long what a new writer is to write waits for readers to find it: those of Fast DDS may
  /// need more than 1 s.
  static constexpr std::chrono::seconds kDiscovery{3};

  /// base: the topics' prefix, as ROS 2 writes it, without a first slash.
  DdsTopics(const DdsParticipant& participant, std::string base);
  ~DdsTopics();
  DdsTopics(const DdsTopics&) = delete;
  DdsTopics& operator=(const DdsTopics&) = delete;

  /// When readers have found its writer, which is made if there is none. Throws
  /// std::runtime_error.
  Clock::time_point begin_of(const TopicMessage& message) { return writer_for(message).begin; }
  std::optional<Error> publish(const TopicMessage& message);

 private:
  struct Writer {
    TopicPublisher of;
    std::unique_ptr<RawTopic> topic;
    int entity = 0;
    Clock::time_point begin{};
  };

  const Writer& writer_for(const TopicMessage& message);

  const DdsParticipant& participant_;
  const std::string base_;
  std::vector<Writer> writers_;  // the one that wrote last at the end
};

}  // namespace orbbuf
