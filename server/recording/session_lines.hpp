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

/// As times.txt has it; 0: unknown.
std::string exposure_ms(std::uint32_t exposure_ns);

/// Of late.csv: `123,1.633012000,8.500000,0A1B2C3D,,1763779406.123456789,80`.
struct Late {
  Sequence sequence = 0;
  std::int64_t capture_time_ns = 0;
  std::string exposure_ms;                   ///< as times.txt has it
  std::uint32_t crc = 0;                     ///< of the image, of stereo frames the left one
  std::optional<std::uint32_t> crc_right{};  ///< nothing: the frame is not stereo
  std::int64_t arrived_ns = 0;               ///< since the Unix epoch
  std::uint8_t quality = 0;                  ///< 0: unknown

  friend bool operator==(const Late&, const Late&) = default;
};
inline constexpr std::string_view kLateHeader =
    "sequence,capture_time_s,exposure_ms,crc,crc_right,arrived_s,quality";
std::string to_csv(const Late& late);
std::optional<Late> parse_late(std::string_view line);

/// Of checksums.sfv: `images/000123.jpg 0A1B2C3D`. image: its path in the folder.
std::string checksum(std::string_view image, std::uint32_t crc);
struct Checksum {
  std::string_view image;
  std::uint32_t crc = 0;

  friend bool operator==(const Checksum&, const Checksum&) = default;
};
/// Eight hexadecimal digits behind the last blank. The image points into `line`.
std::optional<Checksum> parse_checksum(std::string_view line);

/// Of quality.csv: `123,30,40123,0A1B2C3D`; of a whole frame `123,80,0,00000000`.
struct Quality {
  Sequence sequence = 0;
  std::uint8_t quality = 0;  ///< this and the others as EncodedFrame has them
  std::uint32_t whole_bytes = 0;
  std::uint32_t whole_crc = 0;

  /// A frame of which nothing of this is known has no line.
  bool is_known() const { return quality > 0 || whole_bytes > 0; }
  friend bool operator==(const Quality&, const Quality&) = default;
};
inline constexpr std::string_view kQualityHeader = "sequence,quality,whole_bytes,whole_crc";
std::string to_csv(const Quality& quality);
std::optional<Quality> parse_quality(std::string_view line);

}  // namespace orbbuf::session_lines
