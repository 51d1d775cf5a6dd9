// SPDX-License-Identifier: Apache-2.0
#include "common/drop_record.hpp"

#include <spdlog/fmt/fmt.h>

namespace orbbuf {

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
  }
  return "unknown";
}

std::string to_csv(const DropRecord& record) {
  return fmt::format("{},{},{}", record.sequence, to_string(record.reason),
                     format_seconds(record.capture_time_ns));
}

std::string format_seconds(std::int64_t time_ns) {
  constexpr std::uint64_t kNsPerSecond = 1'000'000'000;
  // Unsigned negation, since the most negative time has no positive twin.
  const auto bits = static_cast<std::uint64_t>(time_ns);
  const std::uint64_t magnitude = time_ns < 0 ? 0 - bits : bits;
  return fmt::format("{}{}.{:09}", time_ns < 0 ? "-" : "", magnitude / kNsPerSecond,
                     magnitude % kNsPerSecond);
}

}  // namespace orbbuf
