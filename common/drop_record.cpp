// SPDX-License-Identifier: Apache-2.0
#include "common/drop_record.hpp"

#include <fmt/core.h>

#include <array>
#include <cmath>
#include <cstddef>

#include "common/decimal.hpp"

namespace orbbuf {

std::string_view to_string(DropReason reason) {
  constexpr std::array<std::string_view, 7> kNames = {"policy",  "busy",    "failed", "shutdown",
                                                      "refused", "unknown", "lost"};
  const auto place = static_cast<std::size_t>(reason) - 1;
  return place < kNames.size() ? kNames[place] : "";
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

DropRecord DropRecord::part(Sequence begin, Sequence end) const {
  DropRecord part = *this;
  part.sequence = begin;
  part.frames = end - begin;
  part.capture_time_ns = capture_time_of(begin);
  part.last_capture_time_ns = part.frames > 1 ? capture_time_of(end - 1) : 0;
  return part;
}

bool cut(std::vector<DropRecord>& records, std::uint64_t most) {
  for (auto record = records.begin(); record != records.end(); ++record) {
    if (record->frames <= most) {
      most -= record->frames;
      continue;
    }
    if (most > 0) {
      *record = record->part(record->sequence, record->sequence + most);
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
