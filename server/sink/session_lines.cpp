// SPDX-License-Identifier: Apache-2.0
#include "server/sink/session_lines.hpp"

#include <spdlog/fmt/fmt.h>

#include <charconv>

#include "common/drop_record.hpp"

namespace orbbuf::session_lines {

std::string to_text(const Times& times) {
  return fmt::format("{} {} {}", times.sequence, format_seconds(times.capture_time_ns),
                     times.exposure_ms);
}

std::optional<Times> parse_times(std::string_view line) {
  const auto first = line.find(' ');
  const auto second = line.rfind(' ');
  if (first == second) return std::nullopt;
  Times times;
  const char* const end = line.data() + first;
  const auto [stop, failed] = std::from_chars(line.data(), end, times.sequence);
  const auto time = parse_seconds(line.substr(first + 1, second - first - 1));
  if (failed != std::errc{} || stop != end || !time) return std::nullopt;
  times.capture_time_ns = *time;
  times.exposure_ms = line.substr(second + 1);
  return times;
}

std::string checksum(std::string_view image, std::uint32_t crc) {
  return fmt::format("{} {:08X}", image, crc);
}

}  // namespace orbbuf::session_lines
