// SPDX-License-Identifier: Apache-2.0
#include "server/recording/session_closing.hpp"

#include <spdlog/fmt/fmt.h>

#include <limits>

#include "common/decimal.hpp"

namespace orbbuf {
namespace {

constexpr std::string_view kCounts = "state,captured,skipped,failed,dropped,acknowledged";
constexpr std::string_view kClockOffset = ",clock_offset_ns";
constexpr std::string_view kEnded = "ended";
constexpr std::string_view kOpen = "open";
constexpr std::string_view kUnknown = ",,,,,";

/// Without it nothing is taken.
bool take(std::string_view& text, std::string_view what) {
  if (!text.starts_with(what)) return false;
  text.remove_prefix(what.size());
  return true;
}

/// From a comma on to the next comma, or to the end of the line.
std::optional<std::string_view> take_field(std::string_view& text) {
  if (!take(text, ",")) return std::nullopt;
  const auto field = text.substr(0, text.find_first_of(",\n"));
  text.remove_prefix(field.size());
  return field;
}

std::optional<wire::Stats> take_stats(std::string_view& text) {
  wire::Stats stats;
  for (std::uint64_t* count :
       {&stats.captured, &stats.skipped, &stats.failed, &stats.dropped, &stats.acknowledged}) {
    const auto field = take_field(text);
    const auto number = field ? parse_digits(*field) : std::nullopt;
    if (!number) return std::nullopt;
    *count = *number;
  }
  return stats;
}

/// False if it is neither empty nor a number.
bool take_offset(std::string_view& text, std::optional<std::int64_t>& offset) {
  auto field = take_field(text);
  if (!field) return false;
  if (field->empty()) return true;
  const bool is_negative = take(*field, "-");
  const auto number = parse_digits(*field);
  if (!number || *number > static_cast<std::uint64_t>(std::numeric_limits<std::int64_t>::max())) {
    return false;
  }
  offset = static_cast<std::int64_t>(*number) * (is_negative ? -1 : 1);
  return true;
}

}  // namespace

std::string to_csv(const SessionClosing& closing) {
  std::string text =
      fmt::format("{}{}\n{}", kCounts, kClockOffset, closing.has_ended ? kEnded : kOpen);
  if (closing.stats) {
    const wire::Stats& stats = *closing.stats;
    text += fmt::format(",{},{},{},{},{}", stats.captured, stats.skipped, stats.failed,
                        stats.dropped, stats.acknowledged);
  } else {
    text += kUnknown;
  }
  text += ',';
  if (closing.clock_offset_ns) text += std::to_string(*closing.clock_offset_ns);
  return text + '\n';
}

std::optional<SessionClosing> closing_from_csv(std::string_view text) {
  if (!take(text, kCounts)) return std::nullopt;
  const bool has_clock = take(text, kClockOffset);
  SessionClosing closing;
  if (!take(text, "\n")) return std::nullopt;
  closing.has_ended = take(text, kEnded);
  if (!closing.has_ended && !take(text, kOpen)) return std::nullopt;
  if (text.starts_with(kUnknown)) {
    text.remove_prefix(kUnknown.size());
  } else {
    closing.stats = take_stats(text);
    if (!closing.stats) return std::nullopt;
  }
  if (has_clock && !take_offset(text, closing.clock_offset_ns)) return std::nullopt;
  if (text != "\n") return std::nullopt;
  return closing;
}

}  // namespace orbbuf
