// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "common/drop_record.hpp"
#include "daemon/record/drop_ranges.hpp"

namespace orbbuf {

/// The drop records of the present session on their way to the server, as a stream of numbered
/// items: kept until acknowledged, sent again on a new connection. A record gets its number when it
/// is first sent, and not while kMostKept wait for the server's acknowledgement; until then it may
/// become part of another (DropRanges).
///
/// Reentrant. Memory: that of DropRanges, and 48 bytes for each record that was sent: of those that
/// are not acknowledged, and of those that are, at most kMostKept each.
class GivenUp {
 public:
  static constexpr std::size_t kMostKept = 16384;

  struct Items {
    std::uint64_t first = 0;  ///< the number of the first
    std::vector<DropRecord> records;
  };

  void add(std::span<const DropRecord> records) {
    for (const DropRecord& record : records) waiting_.add(record);
  }

  /// A new connection begins: the server has the items below `next`. The rest is sent again, even
  /// acknowledged ones, if they are among the newest kMostKept of these.
  void rewind(std::uint64_t next) {
    sent_ = 0;
    for (; next < first_ && !kept_.empty(); --first_) {
      numbered_.push_front(kept_.back());
      kept_.pop_back();
    }
    acknowledge(next);
  }

  /// The server has the items below `next`.
  void acknowledge(std::uint64_t next) {
    for (; first_ < next && !numbered_.empty(); ++first_) {
      kept_.push_back(numbered_.front());
      numbered_.pop_front();
      if (sent_ > 0) --sent_;
      if (kept_.size() > kMostKept) kept_.pop_front();
    }
  }

  bool has_unsent() const { return sent_ < numbered_.size() || may_number(); }
  /// The next ones to send, at most `most`. Requires has_unsent().
  Items take_unsent(std::size_t most) {
    if (sent_ == numbered_.size()) {
      for (std::size_t i = 0; i < most && may_number(); ++i) {
        numbered_.push_back(waiting_.take_first());
      }
    }
    const auto begin = numbered_.begin() + static_cast<std::ptrdiff_t>(sent_);
    const std::size_t count = std::min(numbered_.size() - sent_, most);
    Items items{first_ + sent_, {begin, begin + static_cast<std::ptrdiff_t>(count)}};
    sent_ += count;
    return items;
  }

  /// Behind the last number that was ever sent.
  std::uint64_t end() const { return first_ + numbered_.size(); }
  /// The server has acknowledged all records.
  bool is_settled() const { return numbered_.empty() && waiting_.is_empty(); }
  /// Each frame below it that was given up is in a record that the server has acknowledged, if it
  /// has acknowledged all frames below `confirmed`.
  Sequence settled_below(Sequence confirmed) const {
    if (!waiting_.is_empty()) confirmed = std::min(confirmed, waiting_.by_number().begin()->first);
    for (const DropRecord& record : numbered_) confirmed = std::min(confirmed, record.sequence);
    return confirmed;
  }

 private:
  bool may_number() const { return !waiting_.is_empty() && numbered_.size() < kMostKept; }

  DropRanges waiting_;               // never sent
  std::deque<DropRecord> numbered_;  // sent at least once, not acknowledged
  std::deque<DropRecord> kept_;      // acknowledged, the newest last
  std::uint64_t first_ = 0;          // number of the oldest of numbered_
  std::size_t sent_ = 0;             // how many of numbered_ this connection has sent
};

}  // namespace orbbuf
