// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "common/sample.hpp"

namespace orbbuf {

/// The samples of one sensor, or the messages of a topic, on their way to the server, numbered from
/// 0 in the order of time: kept until acknowledged, sent again on a new connection. It never thins
/// them, but where the newest message is all that is wanted. When it is full, the oldest one that
/// was never sent goes, and its number is left out: it comes late if the robot's record has it,
/// else it is lost.
///
/// At any time captured = delivered + waiting + late + lost. Reentrant.
class SampleQueue {
 public:
  static constexpr std::size_t kBytesPerSample = 80;

  /// bytes: of all that wait, but one may wait whatever it takes; kBytesPerSample each, and its own
  /// of a message. is_latest_only: one that was never sent goes when the next one comes.
  explicit SampleQueue(std::uint64_t bytes, bool is_latest_only = false);

  /// False: it is a sample not newer than the one before, or a message too long to be sent, which
  /// is lost.
  bool push(const Sample& sample);

  /// A new connection begins: the server has the samples below `next`.
  void rewind(std::uint64_t next);
  /// The server has the samples below `next`.
  void acknowledge(std::uint64_t next);

  struct Batch {
    std::uint64_t first = 0;  ///< the number of the first; those of the others follow
    std::vector<Sample> samples;
    std::size_t message_bytes = 0;  ///< of topics
  };
  /// The next ones to send, up to `upto_ns`; nothing: there are none.
  std::optional<Batch> take(std::int64_t upto_ns);
  /// Those that wait and are not in the record yet, the oldest of them; it may be empty.
  Batch unrecorded() const;
  /// The record has all that wait below `end`.
  void set_recorded(std::uint64_t end) { recorded_end_ = end; }
  struct Range {
    std::uint64_t begin = 0;
    std::uint64_t end = 0;
  };
  /// The numbers that became late since the last call.
  std::vector<Range> take_late() { return std::exchange(new_late_, {}); }
  /// So many of them the record has lost.
  void lose_late(std::uint64_t count) {
    late_ -= count;
    lost_ += count;
  }

  bool has_unsent() const { return sent_ < waiting_.size(); }
  /// Between the oldest and the newest unsent one.
  std::int64_t unsent_ns() const;

  /// Below it, none waits.
  std::uint64_t first_waiting() const { return waiting_.empty() ? end_ : waiting_.front().number; }
  /// Behind the last number that was ever sent.
  std::uint64_t sent_end() const { return sent_end_; }
  bool is_settled() const { return waiting_.empty(); }

  bool is_latest_only() const { return is_latest_only_; }
  std::uint64_t captured() const { return end_; }
  std::uint64_t delivered() const { return end_ - lost_ - late_ - waiting_.size(); }
  std::uint64_t waiting() const { return waiting_.size(); }
  std::uint64_t late() const { return late_; }
  std::uint64_t lost() const { return lost_; }

 private:
  struct Entry {
    std::uint64_t number;
    Sample sample;
  };

  static bool add(const Entry& entry, Batch& batch);
  void make_room();

  const std::uint64_t most_bytes_;
  const bool is_latest_only_;
  std::uint64_t bytes_ = 0;     // of those that wait
  std::deque<Entry> waiting_;   // not acknowledged, the oldest first
  std::size_t sent_ = 0;        // how many of them this connection has sent
  std::uint64_t end_ = 0;       // the next sample's number
  std::uint64_t sent_end_ = 0;  // behind the last that was ever sent
  std::uint64_t recorded_end_ = 0;
  std::vector<Range> new_late_;
  std::uint64_t late_ = 0;
  std::uint64_t lost_ = 0;
  std::optional<std::int64_t> last_time_ns_;
};

}  // namespace orbbuf
