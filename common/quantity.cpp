// SPDX-License-Identifier: Apache-2.0
#include "common/quantity.hpp"

#include <fmt/core.h>

#include <array>
#include <charconv>
#include <cmath>
#include <span>

namespace orbbuf {
namespace {

struct Unit {
  std::string_view name;
  std::int64_t factor;
};

// Largest first.
constexpr std::array<Unit, 6> kTimes = {{{"h", 3'600'000'000'000},
                                         {"min", 60'000'000'000},
                                         {"s", 1'000'000'000},
                                         {"ms", 1'000'000},
                                         {"us", 1'000},
                                         {"ns", 1}}};
constexpr std::array<Unit, 5> kSizes = {
    {{"TiB", 1LL << 40}, {"GiB", 1 << 30}, {"MiB", 1 << 20}, {"KiB", 1 << 10}, {"B", 1}}};

std::optional<std::int64_t> parse(std::string_view text, std::span<const Unit> units) {
  double number = 0;
  const char* const end = text.data() + text.size();
  const auto [stop, failure] = std::from_chars(text.data(), end, number, std::chars_format::fixed);
  if (failure != std::errc() || !std::isfinite(number)) return std::nullopt;
  std::string_view name(stop, static_cast<std::size_t>(end - stop));
  if (name.starts_with(' ')) name.remove_prefix(1);
  for (const Unit& unit : units) {
    if (unit.name != name) continue;
    const double amount = std::round(number * static_cast<double>(unit.factor));
    constexpr double kLimit = 9223372036854775808.0;  // 2^63
    if (!(std::abs(amount) < kLimit)) return std::nullopt;
    return static_cast<std::int64_t>(amount);
  }
  return std::nullopt;
}

/// Always finds a unit: the last one has the factor 1.
std::string format(std::uint64_t magnitude, std::string_view sign, std::span<const Unit> units,
                   std::string_view zero) {
  if (magnitude == 0) return std::string(zero);
  for (const Unit& unit : units) {
    const auto factor = static_cast<std::uint64_t>(unit.factor);
    if (magnitude % factor == 0) return fmt::format("{}{} {}", sign, magnitude / factor, unit.name);
  }
  return {};
}

}  // namespace

std::optional<std::chrono::nanoseconds> parse_duration(std::string_view text) {
  const auto amount = parse(text, kTimes);
  if (!amount) return std::nullopt;
  return std::chrono::nanoseconds(*amount);
}

std::optional<std::uint64_t> parse_bytes(std::string_view text) {
  const auto amount = parse(text, kSizes);
  if (!amount || *amount < 0 || text.starts_with('-')) return std::nullopt;
  return static_cast<std::uint64_t>(*amount);
}

std::string format_duration(std::chrono::nanoseconds duration) {
  const auto bits = static_cast<std::uint64_t>(duration.count());
  const bool is_negative = duration.count() < 0;
  return format(is_negative ? 0 - bits : bits, is_negative ? "-" : "", kTimes, "0 s");
}

std::string format_bytes(std::uint64_t bytes) { return format(bytes, "", kSizes, "0 B"); }

}  // namespace orbbuf
