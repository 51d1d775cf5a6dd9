// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/wire.hpp"

namespace orbbuf {

/// One reading of an inertial sensor, in the axes of the sensor.
struct Sample {
  std::int64_t time_ns = 0;                     ///< on the clock of the frames
  std::array<double, 3> angular_velocity{};     ///< rad/s
  std::array<double, 3> linear_acceleration{};  ///< m/s^2, gravity included

  friend bool operator==(const Sample&, const Sample&) = default;
};

/// The first line of EuRoC's imu0/data.csv, with its line end.
inline constexpr std::string_view kEurocImuHeader =
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n";

/// A line of that file, with its line end. The numbers are the shortest that read back the same.
std::string to_euroc_line(const Sample& sample);
/// Reads such a line, without its line end. Nothing: it is not seven finite numbers.
std::optional<Sample> parse_euroc_line(std::string_view line);
/// For messages: what a line is to be that could not be read.
inline constexpr std::string_view kExpectedEurocLine =
    "expected the time in ns and six numbers, with commas between them";

namespace wire {

/// StreamDeclaration::codec of a stream of samples.
inline constexpr std::string_view kSampleCodec = "imu";
inline constexpr std::size_t kMaxSamplesPerMessage = 1024;

/// A stream's name becomes the name of a folder beside images/: imu, imu0, imu_left, ...
bool is_sample_stream(const StreamDeclaration& stream);

/// The payload of items: 1 to kMaxSamplesPerMessage samples.
std::vector<std::uint8_t> encode_samples(std::span<const Sample> samples);
Parsed<std::vector<Sample>> parse_samples(std::span<const std::uint8_t> payload);

}  // namespace wire
}  // namespace orbbuf
