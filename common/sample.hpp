// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/wire.hpp"

namespace orbbuf {

/// A publisher of a ROS 2 topic on the robot, as it announced itself on DDS.
struct TopicPublisher {
  std::uint64_t key = 0;    ///< of this publisher, in the session
  std::string topic;        ///< as ROS 2 has it: `/odom`
  std::string type;         ///< as DDS has it: `nav_msgs::msg::dds_::Odometry_`
  std::string user_data;    ///< such as the hash of the type: `typehash=RIHS01_...;`
  std::uint32_t depth = 1;  ///< the messages that it keeps for late readers, if `is_latched`
  bool is_reliable = false;
  bool is_latched = false;  ///< durability `transient local`
  bool is_xcdr2 = false;

  friend bool operator==(const TopicPublisher&, const TopicPublisher&) = default;
};

/// A message of a topic.
struct TopicMessage {
  std::shared_ptr<const TopicPublisher> publisher;
  std::int64_t time_ns = 0;       ///< when it was written
  std::vector<std::uint8_t> cdr;  ///< as on DDS, its header of 4 bytes included
};

/// One reading of an inertial sensor, in the axes of the sensor; or a message of a topic.
struct Sample {
  std::int64_t time_ns = 0;                       ///< on the clock of the frames
  std::array<double, 3> angular_velocity{};       ///< rad/s
  std::array<double, 3> linear_acceleration{};    ///< m/s^2, gravity included
  std::shared_ptr<const TopicMessage> message{};  ///< of a topic: then the numbers are 0

  friend bool operator==(const Sample&, const Sample&) = default;
};

/// The first line of EuRoC's imu0/data.csv, with its line end.
inline constexpr std::string_view kEurocImuHeader =
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n";

/// A line of that file, with its line end. The numbers are the shortest that read back the same.
std::string to_euroc_line(const Sample& sample);
/// The lines of a message of a topic: its time, its topic, its type and its bytes in hex.
inline constexpr std::string_view kMessageHeader = "#timestamp [ns],topic,type,cdr\n";
std::string to_message_line(const TopicMessage& message);
/// Of either kind.
std::string to_line(const Sample& sample);
/// Reads such a line, without its line end. Nothing: it is not seven finite numbers.
std::optional<Sample> parse_euroc_line(std::string_view line);
/// For messages: what a line is to be that could not be read.
inline constexpr std::string_view kExpectedEurocLine =
    "expected the time in ns and six numbers, with commas between them";

namespace wire {

/// StreamDeclaration::codec of a stream of samples.
inline constexpr std::string_view kSampleCodec = "imu";
/// And of one of messages.
inline constexpr std::string_view kTopicCodec = "ros2";
inline constexpr std::size_t kMaxSamplesPerMessage = 1024;
inline constexpr std::size_t kMinTopicMessageBytes = 4;
inline constexpr std::size_t kMaxTopicMessageBytes = std::size_t{1} << 20U;  ///< TopicMessage::cdr
inline constexpr std::size_t kMaxTopicTextBytes = 512;  ///< each text of a TopicPublisher

/// A stream's name becomes the name of a folder beside images/: imu, imu0, imu_left, ... That of a
/// topic becomes the name of a file in topics/.
bool is_sample_stream(const StreamDeclaration& stream);

/// Whether it can be sent: its texts are those of ROS 2, and nothing is too long.
bool is_valid(const TopicPublisher& publisher);

/// The payload of items: 1 to kMaxSamplesPerMessage samples, or as many messages of topics, which
/// together have to fit into kMaxItemsBytes.
std::vector<std::uint8_t> encode_samples(std::span<const Sample> samples);
Parsed<std::vector<Sample>> parse_samples(std::string_view codec,
                                          std::span<const std::uint8_t> payload);
/// Of the codec that the stream was declared with.
Parsed<std::vector<Sample>> parse_samples(std::span<const StreamDeclaration> declared,
                                          StreamId stream, std::span<const std::uint8_t> payload);

}  // namespace wire
}  // namespace orbbuf
