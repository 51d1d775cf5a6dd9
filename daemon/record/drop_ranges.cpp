// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/drop_ranges.hpp"

#include <algorithm>
#include <iterator>

namespace orbbuf {

void DropRanges::add(const DropRecord& record) {
  for (Sequence begin = record.sequence; begin < record.end();) {
    const auto next = ranges_.upper_bound(begin);
    if (next != ranges_.begin() && std::prev(next)->second.end() > begin) {
      begin = std::prev(next)->second.end();
      continue;
    }
    const Sequence end = next == ranges_.end() ? record.end() : std::min(record.end(), next->first);
    insert(record.part(begin, end));
    begin = end;
  }
}

void DropRanges::insert(const DropRecord& record) {
  auto range = ranges_.emplace(record.sequence, record).first;
  if (ranges_.size() <= kMostExact) return;
  if (range != ranges_.begin()) range = join_if_alike(std::prev(range), range);
  if (std::next(range) != ranges_.end()) join_if_alike(range, std::next(range));
}

/// The one that has the numbers of `other` then.
DropRanges::Range DropRanges::join_if_alike(Range one, Range other) {
  DropRecord& first = one->second;
  const DropRecord& second = other->second;
  const bool is_alike = first.reason == second.reason || ranges_.size() > kMostReasons;
  if (first.end() != second.sequence || !is_alike) return other;
  first.last_capture_time_ns = second.capture_time_of(second.end() - 1);
  first.frames += second.frames;
  first.similarity = kUnknownSimilarity;
  ranges_.erase(other);
  return one;
}

void DropRanges::remove_below(Sequence number) {
  while (!ranges_.empty() && ranges_.begin()->second.end() <= number) {
    ranges_.erase(ranges_.begin());
  }
}

}  // namespace orbbuf
