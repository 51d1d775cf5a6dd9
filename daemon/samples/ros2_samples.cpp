// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/ros2_samples.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "common/log.hpp"
#include "daemon/topics/header_time.hpp"

namespace orbbuf {
namespace {

constexpr int kDepth = 10'000;  // ten seconds at 1 kHz

using Imu = sensor_msgs_msg_dds__Imu_;
using News = boost::asio::posix::stream_descriptor;

Sample sample_of(const Imu& imu) {
  const auto& [wx, wy, wz] = imu.angular_velocity;
  const auto& [ax, ay, az] = imu.linear_acceleration;
  return {time_ns_of(imu.header), {wx, wy, wz}, {ax, ay, az}};
}

bool has_finite_values(const Sample& sample) {
  const auto finite = [](double value) { return std::isfinite(value); };
  return std::ranges::all_of(sample.angular_velocity, finite) &&
         std::ranges::all_of(sample.linear_acceleration, finite);
}

}  // namespace

Ros2Samples::Ros2Samples(boost::asio::io_context& main, const SampleStreamSettings& settings,
                         Take take)
    : name_(settings.name),
      take_(std::move(take)),
      reader_(settings.topic, {&sensor_msgs_msg_dds__Imu__desc}, kDepth),
      news_(main, ::dup(reader_.fd())),
      timer_(main) {
  receive();
  look_each_second();
}

void Ros2Samples::receive() {
  news_.async_wait(News::wait_read, [this, life = life()](const boost::system::error_code& error) {
    if (error || life.expired()) return;
    take_all();
    receive();
  });
}

/// The reader says when it has been silent for long.
void Ros2Samples::look_each_second() {
  timer_.expires_after(std::chrono::seconds(1));
  timer_.async_wait([this, life = life()](const boost::system::error_code& error) {
    if (error || life.expired()) return;
    take_all();
    look_each_second();
  });
}

void Ros2Samples::take_all() {
  while (const auto message = reader_.take()) {
    const Sample sample = sample_of(*static_cast<const Imu*>(message->data.get()));
    if (has_finite_values(sample)) {
      take_(sample);
    } else if (!std::exchange(is_fault_logged_, true)) {
      log_warn(
          "{}: a message of topic {} is ignored, and so are others like it: a number "
          "is not finite",
          name_, reader_.topic());
    }
  }
}

}  // namespace orbbuf
