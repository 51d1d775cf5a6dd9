// SPDX-License-Identifier: Apache-2.0
#include "server/recording/robot_holds.hpp"

#include <spdlog/fmt/fmt.h>

#include "common/decimal.hpp"

namespace orbbuf {
namespace {

constexpr std::string_view kHeader = "held,first,reported_s\n";

}  // namespace

std::string to_csv(const RobotHolds& holds) {
  return fmt::format("{}{},{},{}\n", kHeader, holds.held,
                     holds.held > 0 ? std::to_string(holds.first) : "",
                     format_seconds(holds.reported_ns));
}

std::optional<RobotHolds> holds_from_csv(std::string_view text) {
  if (!text.starts_with(kHeader) || !text.ends_with('\n')) return std::nullopt;
  text.remove_prefix(kHeader.size());
  const auto first = text.find(',');
  const auto second = text.rfind(',');
  if (first == second) return std::nullopt;
  const auto held = parse_digits(text.substr(0, first));
  const auto lowest = text.substr(first + 1, second - first - 1);
  const auto number = parse_digits(lowest);
  const auto reported_ns = parse_seconds(text.substr(second + 1, text.size() - second - 2));
  if (!held || !reported_ns || number.has_value() == lowest.empty()) return std::nullopt;
  if (*held > 0 && !number) return std::nullopt;
  return RobotHolds{*held, number.value_or(0), *reported_ns};
}

}  // namespace orbbuf
