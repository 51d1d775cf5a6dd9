// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/ros2_samples.hpp"

#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "common/log.hpp"
#include "common/system_clock.hpp"
#include "daemon/topics/header_time.hpp"

namespace orbbuf {
namespace {

constexpr int kDepth = 10'000;  // ten seconds at 1 kHz
constexpr int kMessageDepth = 1000;

using Imu = sensor_msgs_msg_dds__Imu_;
using News = boost::asio::posix::stream_descriptor;

Sample sample_of(const Imu& imu) {
  const auto& [wx, wy, wz] = imu.angular_velocity;
  const auto& [ax, ay, az] = imu.linear_acceleration;
  return {time_ns_of(imu.header), {wx, wy, wz}, {ax, ay, az}};
}

std::chrono::nanoseconds period_of(double rate) {
  return std::chrono::nanoseconds(rate > 0 ? static_cast<std::int64_t>(1e9 / rate) : 0);
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
      is_of_frames_(settings.policy == TopicPolicy::kFrames),
      period_(period_of(settings.rate)),
      reader_(settings.topic,
              settings.kind == "topic" ? TopicReader::Types{}
                                       : TopicReader::Types{&sensor_msgs_msg_dds__Imu__desc},
              settings.kind == "topic" ? kMessageDepth : kDepth),
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
  while (auto message = reader_.take()) {
    if (message->raw) {
      take_message(*std::move(message));
    } else {
      take_imu(*message);
    }
  }
}

/// A message that late readers are to get is never left out. One of the future has the time at
/// which it came, so that it need not wait for a frame of the future. What is of a frame has its
/// stamp.
void Ros2Samples::take_message(TopicReader::Message message) {
  const auto now = std::chrono::steady_clock::now();
  if (!message.raw->publisher->is_latched) {
    if (now < due_) return;
    due_ = std::max(due_, now - period_ / 2) + period_;
  }
  const auto stamp = is_of_frames_ ? header_time_ns(message.raw->cdr) : std::nullopt;
  if (is_of_frames_ && !stamp) return note_fault("it does not begin with a header");
  const std::int64_t time_ns = stamp.value_or(std::min(message.raw->time_ns, system_time_ns()));
  take_({time_ns, {}, {}, std::move(message.raw)});
}

void Ros2Samples::take_imu(const TopicReader::Message& message) {
  const Sample sample = sample_of(*static_cast<const Imu*>(message.data.get()));
  if (!has_finite_values(sample)) return note_fault("a number is not finite");
  take_(sample);
}

void Ros2Samples::note_fault(std::string_view why) {
  if (std::exchange(is_fault_logged_, true)) return;
  log_warn("{}: a message of topic {} is ignored, and so are others like it: {}", name_,
           reader_.topic(), why);
}

}  // namespace orbbuf
