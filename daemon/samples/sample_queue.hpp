// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "common/sample.hpp"

namespace orbbuf {

/// The samples of one sensor on their way to the server, numbered from 0 in the order of time: kept
/// until acknowledged, sent again on a new connection. It never thins them. When it is full, the
/// oldest one that was never sent is lost, and its number is left out.
///
/// At any time captured = delivered + waiting + lost. Reentrant.
class SampleQueue {
 public:
  static constexpr std::size_t kBytesPerSample = 64;

  /// A full queue has bytes / kBytesPerSample samples, at least one.
  explicit SampleQueue(std::uint64_t bytes);

  /// False: it is not newer than the one before, and not taken.
  bool push(const Sample& sample);

  /// A new connection begins: the server has the samples below `next`.
  void rewind(std::uint64_t next);
  /// The server has the samples below `next`.
  void acknowledge(std::uint64_t next);

  struct Batch {
    std::uint64_t first = 0;  ///< the number of the first; those of the others follow
    std::vector<Sample> samples;
  };
  /// The next ones to send, up to `upto_ns`; nothing: there are none.
  std::optional<Batch> take(std::int64_t upto_ns);
  /// Between the oldest and the newest unsent one.
  std::int64_t unsent_ns() const;

  /// Behind the last number that was ever sent.
  std::uint64_t sent_end() const { return sent_end_; }
  bool is_settled() const { return waiting_.empty(); }

  std::uint64_t captured() const { return end_; }
  std::uint64_t delivered() const { return end_ - lost_ - waiting_.size(); }
  std::uint64_t waiting() const { return waiting_.size(); }
  std::uint64_t lost() const { return lost_; }

 private:
  struct Entry {
    std::uint64_t number;
    Sample sample;
  };

  void make_room();

  const std::size_t most_;
  std::deque<Entry> waiting_;   // not acknowledged, the oldest first
  std::size_t sent_ = 0;        // how many of them this connection has sent
  std::uint64_t end_ = 0;       // the next sample's number
  std::uint64_t sent_end_ = 0;  // behind the last that was ever sent
  std::uint64_t lost_ = 0;
  std::optional<std::int64_t> last_time_ns_;
};

}  // namespace orbbuf
