// SPDX-License-Identifier: Apache-2.0
#include "common/decimal.hpp"

#include <fmt/core.h>

#include <cstddef>
#include <limits>

namespace orbbuf {
namespace {

constexpr std::uint64_t kNsPerSecond = 1'000'000'000;
constexpr std::size_t kFractionDigits = 9;

}  // namespace

SplitTime split_seconds(std::int64_t time_ns) {
  constexpr auto kStep = static_cast<std::int64_t>(kNsPerSecond);
  const SplitTime towards_zero{time_ns / kStep, time_ns % kStep};
  if (towards_zero.nanoseconds >= 0) return towards_zero;
  return {towards_zero.seconds - 1, towards_zero.nanoseconds + kStep};
}

std::string format_seconds(std::int64_t time_ns) {
  // Unsigned negation, since the most negative time has no positive twin.
  const auto bits = static_cast<std::uint64_t>(time_ns);
  const std::uint64_t magnitude = time_ns < 0 ? 0 - bits : bits;
  return fmt::format("{}{}.{:09}", time_ns < 0 ? "-" : "", magnitude / kNsPerSecond,
                     magnitude % kNsPerSecond);
}

std::optional<std::int64_t> parse_seconds(std::string_view text) {
  const bool is_negative = text.starts_with('-');
  if (is_negative) text.remove_prefix(1);
  const auto point = text.find('.');
  if (point == std::string_view::npos) return std::nullopt;
  const auto fraction_text = text.substr(point + 1);
  if (fraction_text.size() != kFractionDigits) return std::nullopt;
  const auto whole = parse_digits(text.substr(0, point));
  const auto fraction = parse_digits(fraction_text);
  constexpr std::uint64_t kLargest = std::numeric_limits<std::int64_t>::max();
  if (!whole || !fraction || *whole > kLargest / kNsPerSecond) return std::nullopt;
  const std::uint64_t magnitude = *whole * kNsPerSecond + *fraction;
  // The most negative time has no positive twin.
  if (magnitude > kLargest + (is_negative ? 1 : 0)) return std::nullopt;
  return static_cast<std::int64_t>(is_negative ? 0 - magnitude : magnitude);
}

}  // namespace orbbuf
