// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/frame.hpp"

/// The lines of a session's text files (session_files.hpp says what they are), without line ends.
/// Those of drops.csv are in common/drop_record.hpp.
namespace orbbuf::session_lines {

/// Of times.txt: `123 1.633012000 0.000000`.
struct Times {
  Sequence sequence = 0;
  std::int64_t capture_time_ns = 0;
  std::string_view exposure_ms;  ///< as it is written

  friend bool operator==(const Times&, const Times&) = default;
};
std::string to_text(const Times& times);
/// Three words, the first two of them numbers; what the third is, is not looked at. It points into
/// `line`.
std::optional<Times> parse_times(std::string_view line);

/// Of checksums.sfv: `images/000123.jpg 0A1B2C3D`. image: its path in the folder.
std::string checksum(std::string_view image, std::uint32_t crc);
struct Checksum {
  std::string_view image;
  std::uint32_t crc = 0;

  friend bool operator==(const Checksum&, const Checksum&) = default;
};
/// Eight hexadecimal digits behind the last blank. The image points into `line`.
std::optional<Checksum> parse_checksum(std::string_view line);

}  // namespace orbbuf::session_lines
