// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "common/unique_fd.hpp"
#include "daemon/capture/camera_source.hpp"
#include "daemon/topics/topic_reader.hpp"

namespace orbbuf {

/// The images that a node on this robot publishes by ROS 2: sensor_msgs/msg/CompressedImage with
/// JPEG, which is passed on, or sensor_msgs/msg/Image. The header's stamp is the capture time,
/// as StampClock has it. It waits for a publisher, at the start as well, as TopicReader does.
class Ros2Source final : public FrameSource {
 public:
  /// color: whether images in YUV keep their colour. Throws std::runtime_error if there is no DDS.
  Ros2Source(const std::string& topic, bool color);
  /// Logs the counts.
  ~Ros2Source() override;

  std::optional<RawFrame> next(std::stop_token stop) override;
  bool is_live() const override { return true; }
  std::string description() const override;

 private:
  RawFrame frame_of(const TopicReader::Message& message);

  const bool is_color_;
  const UniqueFd stop_event_;  // readable once next() has to return
  TopicReader reader_;
  CaptureClock clock_;  // of the arrivals
  StampClock stamps_;
  std::uint64_t frames_ = 0;
};

}  // namespace orbbuf
