// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <map>

#include "common/drop_record.hpp"

namespace orbbuf {

/// The frames of a session that were given up, by number, each once.
///
/// Up to kMostExact records stay as they were added. Beyond that a new one becomes part of one that
/// it touches and that has the same reason; beyond kMostReasons, whatever its reason is. So there
/// are at most about as many as there are gaps between the numbers, and a long outage has few: what
/// is not given up is in the buffer, which is bounded.
///
/// Reentrant. Memory: 100 bytes a record. Adding takes time in proportion to the logarithm of their
/// count.
class DropRanges {
 public:
  static constexpr std::size_t kMostExact = 16384;
  static constexpr std::size_t kMostReasons = 65536;

  /// Numbers that are there already stay as they are.
  void add(const DropRecord& record);
  /// Those of which all numbers are below `number`.
  void remove_below(Sequence number);
  /// The one with the lowest numbers. Requires !is_empty().
  DropRecord take_first() { return ranges_.extract(ranges_.begin()).mapped(); }

  bool is_empty() const { return ranges_.empty(); }
  std::size_t size() const { return ranges_.size(); }
  /// By their first numbers; none overlaps another.
  const std::map<Sequence, DropRecord>& by_number() const { return ranges_; }

 private:
  using Range = std::map<Sequence, DropRecord>::iterator;
  void insert(const DropRecord& record);
  Range join_if_alike(Range one, Range other);

  std::map<Sequence, DropRecord> ranges_;
};

}  // namespace orbbuf
