// SPDX-License-Identifier: Apache-2.0
#include "server/session/session_lines.hpp"

#include <fmt/format.h>

#include "common/decimal.hpp"
#include "server/session/session_names.hpp"

namespace orbbuf::session_lines {

std::string names(const SessionInfo& info) {
  return fmt::format("robot {}\nsession {}\n", info.robot_id, info.session_id);
}

std::string times(Sequence sequence, std::int64_t capture_time_ns, std::uint32_t exposure_ns) {
  return fmt::format("{} {} {}\n", sequence, format_seconds(capture_time_ns),
                     exposure_ms(exposure_ns));
}

std::optional<Times> parse_times(std::string_view line) {
  const auto first = line.find(' ');
  const auto second = line.rfind(' ');
  if (first == second) return std::nullopt;
  const auto sequence = parse_digits(line.substr(0, first));
  const auto time = parse_seconds(line.substr(first + 1, second - first - 1));
  if (!sequence || !time) return std::nullopt;
  return Times{*sequence, *time, line.substr(second + 1)};
}

std::string exposure_ms(std::uint32_t exposure_ns) {
  constexpr std::uint32_t kNsPerMs = 1'000'000;
  return fmt::format("{}.{:06}", exposure_ns / kNsPerMs, exposure_ns % kNsPerMs);
}

std::string checksums(const RecordedFrame& frame) {
  auto lines = fmt::format("{} {:08X}\n", session_names::left_image(frame.sequence), frame.crc);
  if (frame.is_stereo()) {
    lines +=
        fmt::format("{} {:08X}\n", session_names::right_image(frame.sequence), frame.crc_right);
  }
  return lines;
}

std::string quality(const RecordedFrame& frame) {
  if (frame.quality == 0 && !frame.is_reduced()) return "";
  return fmt::format("{},{},{},{:08X}\n", frame.sequence, frame.quality, frame.whole_bytes,
                     frame.whole_crc);
}

}  // namespace orbbuf::session_lines
