// SPDX-License-Identifier: Apache-2.0
#include "server/recording/session_lines.hpp"

#include <spdlog/fmt/fmt.h>

#include "common/decimal.hpp"

namespace orbbuf::session_lines {

std::string to_text(const Times& times) {
  return fmt::format("{} {} {}", times.sequence, format_seconds(times.capture_time_ns),
                     times.exposure_ms);
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

std::string checksum(std::string_view image, std::uint32_t crc) {
  return fmt::format("{} {:08X}", image, crc);
}

}  // namespace orbbuf::session_lines
