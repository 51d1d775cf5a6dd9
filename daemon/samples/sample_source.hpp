// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "common/sample.hpp"

namespace orbbuf {

/// A `[stream.NAME]` of orbbufd.toml.
struct SampleStreamSettings {
  std::string name;  ///< of the sensor or topic: wire::is_sample_stream()
  std::string kind;  ///< `euroc`, `socket`, `iio`, `ros2`, `generated` or `topic`
  std::filesystem::path path{};
  std::uint64_t memory_bytes = 48U << 20;  ///< ten minutes at 1 kHz
  std::vector<std::string> devices{};      ///< of `iio`
  std::string topic{};                     ///< of `ros2`: of sensor_msgs/msg/Imu
  bool is_latest_only = false;             ///< policy `latest`
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
