// SPDX-License-Identifier: Apache-2.0
#include "common/drop_record.hpp"

#include <spdlog/fmt/fmt.h>

#include "common/decimal.hpp"

namespace orbbuf {
namespace {

std::optional<DropReason> parse_reason(std::string_view text) {
  for (const auto reason :
       {DropReason::kPolicy, DropReason::kBusy, DropReason::kFailed, DropReason::kShutdown,
        DropReason::kRefused, DropReason::kUnknown, DropReason::kLost, DropReason::kLate}) {
    if (to_string(reason) == text) return reason;
  }
  return std::nullopt;
}

}  // namespace

std::string_view to_string(DropReason reason) {
  switch (reason) {
    case DropReason::kPolicy:
      return "policy";
    case DropReason::kBusy:
      return "busy";
    case DropReason::kFailed:
      return "failed";
    case DropReason::kShutdown:
      return "shutdown";
    case DropReason::kRefused:
      return "refused";
    case DropReason::kUnknown:
      return "unknown";
    case DropReason::kLost:
      return "lost";
    case DropReason::kLate:
      return "late";
  }
  return "";
}

std::string to_csv(const DropRecord& record) {
  return fmt::format("{},{},{}", record.sequence, to_string(record.reason),
                     format_seconds(record.capture_time_ns));
}

std::optional<DropRecord> drop_from_csv(std::string_view line) {
  const auto first = line.find(',');
  const auto second = line.rfind(',');
  if (first == second) return std::nullopt;
  const auto sequence = parse_digits(line.substr(0, first));
  const auto reason = parse_reason(line.substr(first + 1, second - first - 1));
  const auto time = parse_seconds(line.substr(second + 1));
  if (!sequence || !reason || !time) return std::nullopt;
  return DropRecord{*sequence, *time, *reason};
}

}  // namespace orbbuf
