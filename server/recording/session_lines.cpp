// SPDX-License-Identifier: Apache-2.0
#include "server/recording/session_lines.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstddef>
#include <limits>
#include <system_error>

#include "common/decimal.hpp"

namespace orbbuf::session_lines {
namespace {

std::optional<std::uint32_t> parse_crc(std::string_view text) {
  constexpr std::size_t kDigits = 8;
  if (text.size() != kDigits) return std::nullopt;
  std::uint32_t crc = 0;
  const char* const end = text.data() + text.size();
  const auto [stop, failed] = std::from_chars(text.data(), end, crc, 16);
  if (failed != std::errc{} || stop != end) return std::nullopt;
  return crc;
}

/// The fields of a line of CSV; nothing if there are more or fewer.
template <std::size_t Count>
std::optional<std::array<std::string_view, Count>> split(std::string_view line) {
  std::array<std::string_view, Count> fields;
  for (std::size_t i = 0; i < Count; ++i) {
    const auto end = line.find(',');
    if ((end == line.npos) != (i + 1 == Count)) return std::nullopt;
    fields[i] = line.substr(0, end);
    line.remove_prefix(std::min(end, line.size() - 1) + 1);
  }
  return fields;
}

template <class Number>
std::optional<Number> parse_up_to(std::string_view text, Number most) {
  const auto number = parse_digits(text);
  if (!number || *number > most) return std::nullopt;
  return static_cast<Number>(*number);
}

}  // namespace

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

std::string exposure_ms(std::uint32_t exposure_ns) {
  constexpr std::uint32_t kNsPerMs = 1'000'000;
  return fmt::format("{}.{:06}", exposure_ns / kNsPerMs, exposure_ns % kNsPerMs);
}

std::string to_csv(const Late& late) {
  return fmt::format("{},{},{},{:08X},{},{},{}", late.sequence,
                     format_seconds(late.capture_time_ns), late.exposure_ms, late.crc,
                     late.crc_right ? fmt::format("{:08X}", *late.crc_right) : "",
                     format_seconds(late.arrived_ns), late.quality);
}

std::optional<Late> parse_late(std::string_view line) {
  const auto fields = split<7>(line);
  if (!fields) return std::nullopt;
  const auto& [number, captured, exposure, left, right, arrived, jpeg_quality] = *fields;
  const auto sequence = parse_digits(number);
  const auto capture_time_ns = parse_seconds(captured);
  const auto crc = parse_crc(left);
  const auto crc_right = parse_crc(right);
  const auto arrived_ns = parse_seconds(arrived);
  const auto quality = parse_up_to(jpeg_quality, kMaxQuality);
  if (!sequence || !capture_time_ns || !crc || !arrived_ns || !quality) return std::nullopt;
  if (!crc_right && !right.empty()) return std::nullopt;
  return Late{*sequence,   *capture_time_ns, std::string(exposure), *crc, crc_right,
              *arrived_ns, *quality};
}

std::string checksum(std::string_view image, std::uint32_t crc) {
  return fmt::format("{} {:08X}", image, crc);
}

std::optional<Checksum> parse_checksum(std::string_view line) {
  const auto blank = line.rfind(' ');
  if (blank == std::string_view::npos) return std::nullopt;
  const auto crc = parse_crc(line.substr(blank + 1));
  if (!crc) return std::nullopt;
  return Checksum{line.substr(0, blank), *crc};
}

std::string to_csv(const Quality& quality) {
  return fmt::format("{},{},{},{:08X}", quality.sequence, quality.quality, quality.whole_bytes,
                     quality.whole_crc);
}

std::optional<Quality> parse_quality(std::string_view line) {
  const auto fields = split<4>(line);
  if (!fields) return std::nullopt;
  const auto& [number, jpeg_quality, bytes, checksum] = *fields;
  const auto sequence = parse_digits(number);
  const auto quality = parse_up_to(jpeg_quality, kMaxQuality);
  const auto whole_bytes = parse_up_to(bytes, std::numeric_limits<std::uint32_t>::max());
  const auto whole_crc = parse_crc(checksum);
  if (!sequence || !quality || !whole_bytes || !whole_crc) return std::nullopt;
  return Quality{*sequence, *quality, *whole_bytes, *whole_crc};
}

}  // namespace orbbuf::session_lines
