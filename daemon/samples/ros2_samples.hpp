// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <string>
#include <string_view>

#include "daemon/samples/sample_source.hpp"
#include "daemon/topics/topic_reader.hpp"

namespace orbbuf {

/// Takes the messages sensor_msgs/msg/Imu that a node on this robot publishes by ROS 2, with the
/// stamps of their headers, without the orientation; or, of the kind `topic`, messages of any type,
/// as they are, with the times at which they were written, or their headers' if they are of frames.
/// It waits for a publisher as TopicReader does.
class Ros2Samples final : public SampleSource {
 public:
  /// Throws std::runtime_error if there is no DDS.
  Ros2Samples(boost::asio::io_context& main, const SampleStreamSettings& settings, Take take);

  /// What was written before the frame goes before it.
  void on_frame(std::int64_t /*time_ns*/) override { take_all(); }

 private:
  void receive();
  void look_each_second();
  void take_all();
  void take_message(TopicReader::Message message);
  void take_imu(const TopicReader::Message& message);
  void note_fault(std::string_view why);

  const std::string name_;
  const Take take_;
  const bool is_of_frames_;
  const std::chrono::nanoseconds period_;  // between messages of a topic, at least
  std::chrono::steady_clock::time_point due_{};
  TopicReader reader_;
  boost::asio::posix::stream_descriptor news_;
  boost::asio::steady_timer timer_;
  bool is_fault_logged_ = false;
};

}  // namespace orbbuf
