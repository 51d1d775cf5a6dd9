// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

#include "common/log.hpp"
#include "common/unique_fd.hpp"
#include "daemon/capture/frame_source.hpp"
#include "daemon/topics/topic_reader.hpp"

namespace orbbuf {

/// The images that a node on this robot publishes by ROS 2: sensor_msgs/msg/CompressedImage with
/// JPEG, which is passed on, or sensor_msgs/msg/Image. The header's stamp is the capture time. An
/// image whose stamp is not after the one before is skipped and logged. It waits for a publisher,
/// at the start as well, as TopicReader does.
class Ros2Source final : public FrameSource {
 public:
  /// color: whether images in YUV keep their colour. Throws std::runtime_error if there is no DDS.
  Ros2Source(const std::string& topic, bool color,
             std::chrono::nanoseconds patience = TopicReader::kPatience);
  /// Logs the counts.
  ~Ros2Source() override;

  /// Also throws if for `patience` all stamps are before one that has come: the
  /// publisher's clock was set back, and a session has one clock.
  std::optional<RawFrame> next(std::stop_token stop) override;
  bool is_live() const override { return true; }
  std::string description() const override;

 private:
  using Clock = std::chrono::steady_clock;

  RawFrame frame_of(const TopicReader::Message& message) const;
  bool is_newer(std::int64_t time_ns);

  const bool is_color_;
  const std::chrono::nanoseconds patience_;
  const UniqueFd stop_event_;  // readable once next() has to return
  TopicReader reader_;
  std::int64_t last_ns_ = -1;
  std::optional<Clock::time_point> behind_since_;  // all images since then were skipped
  LogLimit behind_log_{std::chrono::seconds(10)};
  std::uint64_t frames_ = 0;
  std::uint64_t skipped_ = 0;
};

}  // namespace orbbuf
