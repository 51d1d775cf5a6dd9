// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/sample.hpp"
#include "daemon/samples/sample_queue.hpp"

namespace orbbuf {

/// A `[stream.NAME]` of orbbufd.toml.
struct SampleStreamSettings {
  std::string name;  ///< of the sensor or topic: wire::is_sample_stream()
  std::string kind;  ///< `euroc`, `socket`, `iio`, `ros2`, `generated` or `topic`
  std::filesystem::path path{};
  std::uint64_t memory_bytes = 48U << 20;  ///< ten minutes at 1 kHz
  std::vector<std::string> devices{};      ///< of `iio`
  std::string topic{};                     ///< of `ros2`: of sensor_msgs/msg/Imu
  TopicPolicy policy = TopicPolicy::kAll;  ///< of `topic`
  std::chrono::nanoseconds frame_time{};   ///< between two frames of the camera
  double rate = 0;                         ///< of `topic`: messages a second at most; 0: no limit
};

/// Where the samples of one sensor, or the messages of a topic, come from. Hands each on once, in
/// its order. Thread-bound to `main`; never blocks.
class SampleSource {
 public:
  using Take = std::function<void(const Sample&)>;

  virtual ~SampleSource() = default;
  /// A frame of that time was captured.
  virtual void on_frame(std::int64_t /*time_ns*/) {}

 protected:
  /// Expired once the source is gone: Asio may have queued a handler of it.
  std::weak_ptr<const int> life() const { return life_; }

 private:
  const std::shared_ptr<const int> life_ = std::make_shared<const int>();
};

}  // namespace orbbuf
