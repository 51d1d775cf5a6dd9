// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <charconv>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>

/// Numbers and times as the text files of a session have them.
namespace orbbuf {

/// All of `text` as a number of that type; nothing if it is none, or out of range.
template <class Number>
std::optional<Number> parse_number(std::string_view text) {
  Number number{};
  const char* const end = text.data() + text.size();
  const auto [stop, failed] = std::from_chars(text.data(), end, number);
  return failed == std::errc() && stop == end ? std::optional(number) : std::nullopt;
}

/// A number of nothing but digits; nothing if it is not that, or over 64 bits.
inline std::optional<std::uint64_t> parse_digits(std::string_view text) {
  return parse_number<std::uint64_t>(text);
}

/// Whole seconds, rounded down, and the nanoseconds from there, 0 to 999,999,999. Of any time.
struct SplitTime {
  std::int64_t seconds = 0;
  std::int64_t nanoseconds = 0;

  friend bool operator==(const SplitTime&, const SplitTime&) = default;
};
SplitTime split_seconds(std::int64_t time_ns);

/// Exact decimal seconds with nine digits after the point; negative times keep their sign.
std::string format_seconds(std::int64_t time_ns);
/// format_seconds() read back; nothing if it is not that.
std::optional<std::int64_t> parse_seconds(std::string_view text);

}  // namespace orbbuf
