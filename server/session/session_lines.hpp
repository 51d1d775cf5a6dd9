// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "server/session/records.hpp"

/// The lines of the text files that are views of a session (session_store.hpp says what they are),
/// with their ends. Those of drops.csv are in common/drop_record.hpp.
namespace orbbuf::session_lines {

/// Of session.txt, the first ones: `robot r`, `session s`.
std::string names(const SessionInfo& info);

/// Of times.txt: `123 1.633012000 0.000000`.
std::string times(Sequence sequence, std::int64_t capture_time_ns, std::uint32_t exposure_ns);
inline std::string times(const RecordedFrame& frame) {
  return times(frame.sequence, frame.capture_time_ns, frame.exposure_ns);
}

struct Times {
  Sequence sequence = 0;
  std::int64_t capture_time_ns = 0;
  std::string_view exposure_ms;  ///< as it is written

  friend bool operator==(const Times&, const Times&) = default;
};
/// A line without its end: three words, the first two of them numbers; what the third is, is not
/// looked at. It points into `line`.
std::optional<Times> parse_times(std::string_view line);

/// As times.txt has it; 0: unknown.
std::string exposure_ms(std::uint32_t exposure_ns);

/// Of checksums.sfv: `images/000123.jpg 0A1B2C3D`, a line for each image.
std::string checksums(const RecordedFrame& frame);

/// Of quality.csv: `123,30,40123,0A1B2C3D`; of a whole frame `123,80,0,00000000`; nothing of one of
/// which nothing is known.
std::string quality(const RecordedFrame& frame);
inline constexpr std::string_view kQualityHeader = "sequence,quality,whole_bytes,whole_crc\n";

}  // namespace orbbuf::session_lines
