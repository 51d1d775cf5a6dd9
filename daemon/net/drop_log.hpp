// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <span>

#include "common/drop_record.hpp"
#include "common/wire.hpp"
#include "daemon/net/drop_queue.hpp"

namespace orbbuf {

/// The session's drop records on their way into the server's record: numbered as they come, kept
/// until acknowledged, sent again on a new connection. Thread-bound to `main`.
/// Memory: 1.5 MB; what waits beyond that is in a file (DropQueue).
class DropLog {
 public:
  static constexpr std::size_t kMostKept = 16384;

  void add(std::span<const DropRecord> records);

  /// A new connection begins: the server has the records below `next_drop`; the rest is sent again,
  /// even acknowledged ones, if they are among the newest kMostKept of these.
  void rewind(std::uint64_t next_drop);
  /// The server has the records below `next_drop`.
  void acknowledge(std::uint64_t next_drop);

  bool has_unsent() const { return sent_ < records_.oldest().size(); }
  /// The next records to send, at most wire::kMaxDropsPerMessage. Requires has_unsent().
  wire::Dropped take_unsent();

  /// Number of the record after the last one.
  std::uint64_t next_drop() const { return first_ + records_.size(); }
  /// Number of the oldest one that is not acknowledged.
  std::uint64_t acknowledged() const { return first_; }
  bool is_settled() const { return records_.size() == 0; }

 private:
  DropQueue records_;            // not yet acknowledged
  std::deque<DropRecord> kept_;  // acknowledged, the newest last
  std::uint64_t first_ = 0;      // number of the oldest of records_
  std::size_t sent_ = 0;         // how many of records_ this connection has sent
};

}  // namespace orbbuf
