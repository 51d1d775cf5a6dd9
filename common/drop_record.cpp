// SPDX-License-Identifier: Apache-2.0
#include "common/drop_record.hpp"

#include <fmt/core.h>

#include <cmath>

#include "common/decimal.hpp"

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
    case DropReason::kRefused:
      return "refused";
    case DropReason::kUnknown:
      return "unknown";
    case DropReason::kLost:
      return "lost";
  }
  return "";
}

std::int64_t DropRecord::capture_time_of(Sequence number) const {
  if (frames < 2) return capture_time_ns;
  // The times are the robot's word and may be any: signed arithmetic could overflow.
  const auto begin = static_cast<std::uint64_t>(capture_time_ns);
  const auto all =
      static_cast<std::int64_t>(static_cast<std::uint64_t>(last_capture_time_ns) - begin);
  const double part = static_cast<double>(number - sequence) / static_cast<double>(frames - 1);
  const auto since = std::llround(static_cast<double>(all) * part);
  return static_cast<std::int64_t>(begin + static_cast<std::uint64_t>(since));
}

DropRecord DropRecord::first(std::uint64_t most) const {
  if (frames <= most) return *this;
  DropRecord part = *this;
  part.frames = most;
  part.last_capture_time_ns = most > 1 ? capture_time_of(sequence + most - 1) : 0;
  return part;
}

bool cut(std::vector<DropRecord>& records, std::uint64_t most) {
  for (auto record = records.begin(); record != records.end(); ++record) {
    if (record->frames <= most) {
      most -= record->frames;
      continue;
    }
    if (most > 0) {
      *record = record->first(most);
      ++record;
    }
    records.erase(record, records.end());
    return true;
  }
  return false;
}

std::string to_csv(const DropRecord& record) {
  std::string lines;
  for (Sequence number = record.sequence; number < record.end(); ++number) {
    lines += fmt::format("{},{},{}\n", number, to_string(record.reason),
                         format_seconds(record.capture_time_of(number)));
  }
  return lines;
}

}  // namespace orbbuf
