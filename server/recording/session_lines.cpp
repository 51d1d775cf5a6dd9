// SPDX-License-Identifier: Apache-2.0
#include "server/recording/session_lines.hpp"

#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <system_error>

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

std::optional<Checksum> parse_checksum(std::string_view line) {
  constexpr std::size_t kDigits = 8;
  const auto blank = line.rfind(' ');
  if (blank == std::string_view::npos || line.size() - blank - 1 != kDigits) return std::nullopt;
  std::uint32_t crc = 0;
  const char* const end = line.data() + line.size();
  const auto [stop, failed] = std::from_chars(end - kDigits, end, crc, 16);
  if (failed != std::errc{} || stop != end) return std::nullopt;
  return Checksum{line.substr(0, blank), crc};
}

}  // namespace orbbuf::session_lines
