// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <utility>
#include <vector>

#include "common/sample.hpp"

namespace orbbuf {

/// What a link that is too slow costs of a topic.
enum class TopicPolicy {
  kAll,     ///< nothing, within its memory
  kLatest,  ///< all but the newest message
  kFrames,  ///< what belongs to a frame that is not sent, such as its depth image
};

/// The samples of one sensor, or the messages of a topic, on their way to the server, numbered from
/// 0 in the order of time: kept until acknowledged, sent again on a new connection. It never thins
/// them, but by the TopicPolicy. When it is full, the oldest one that was never sent goes, and its
/// number is left out: it comes late if the robot's record has it, else it is lost.
///
/// At any time captured = delivered + waiting + late + lost. Reentrant.
class SampleQueue {
 public:
  static constexpr std::size_t kBytesPerSample = 80;

  /// bytes: of all that wait, but one may wait whatever it takes; kBytesPerSample each, and its own
  /// of a message. frame_time: between two frames; with the policy kFrames a message is of the
  /// frame that is at most half of it away.
  explicit SampleQueue(std::uint64_t bytes, TopicPolicy policy = TopicPolicy::kAll,
                       std::chrono::nanoseconds frame_time = {});

  /// False: it is a sample not newer than the one before, or a message too long to be sent, and
  /// refused.
  bool push(const Sample& sample);
  /// One that cannot be sent is lost with its number.
  void refuse();

  /// With the policy kFrames: what is of this frame may go, also what comes later. Times increase
  /// from call to call: what is of an older frame that was not sent is given up.
  void on_frame_sent(std::int64_t time_ns);
  /// And what has a time from the one to the other, of frames in a row, is given up. What is beside
  /// them may be of a neighbour.
  void on_frames_dropped(std::int64_t first_ns, std::int64_t last_ns);
  /// And all that is of none that was sent.
  void on_last_frame_sent();

  /// A new connection begins: the server has the samples below `next`.
  void rewind(std::uint64_t next);
  /// The server has the samples below `next`.
  void acknowledge(std::uint64_t next);

  struct Batch {
    std::uint64_t first = 0;  ///< the number of the first; those of the others follow
    std::vector<Sample> samples;
    std::size_t message_bytes = 0;  ///< of topics
  };
  /// The next ones to send, up to `upto_ns`, or with kFrames those of frames that were sent;
  /// nothing: there are none.
  std::optional<Batch> take(std::int64_t upto_ns);
  /// Those that wait and are not in the record yet, the oldest of them; it may be empty. Of a
  /// policy that gives up, only those that were sent: the others may be given up, and must not come
  /// late.
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

  /// take() has some, whatever their time.
  bool has_due() const;
  /// Between the oldest and the newest unsent one.
  std::int64_t unsent_ns() const;

  /// Below it, none waits.
  std::uint64_t first_waiting() const { return waiting_.empty() ? end_ : waiting_.front().number; }
  /// Behind the last number that was ever sent.
  std::uint64_t sent_end() const { return sent_end_; }
  bool is_settled() const { return waiting_.empty(); }

  TopicPolicy policy() const { return policy_; }
  std::uint64_t captured() const { return end_; }
  std::uint64_t delivered() const { return end_ - lost_ - late_ - waiting_.size(); }
  std::uint64_t waiting() const { return waiting_.size(); }
  std::uint64_t late() const { return late_; }
  std::uint64_t lost() const { return lost_; }
  std::uint64_t refused() const { return refused_; }  ///< of the lost ones

 private:
  struct Entry {
    std::uint64_t number;
    Sample sample;
  };

  using Entries = std::deque<Entry>;

  static bool add(const Entry& entry, Batch& batch);
  void make_room();
  Entries::iterator give_up(const Entries::iterator& victim);
  bool is_of_sent_frame(const Entry& entry) const;
  void give_up_between(std::int64_t first_ns, std::int64_t last_ns);
  void give_up_passed();

  const std::uint64_t most_bytes_;
  const TopicPolicy policy_;
  const std::int64_t half_frame_ns_;
  std::deque<std::int64_t> sent_frames_;  // their times, of the last ones
  std::uint64_t bytes_ = 0;               // of those that wait
  Entries waiting_;                       // not acknowledged, the oldest first
  std::size_t sent_ = 0;                  // how many of them this connection has sent
  std::uint64_t end_ = 0;                 // the next sample's number
  std::uint64_t sent_end_ = 0;            // behind the last that was ever sent
  std::uint64_t recorded_end_ = 0;
  std::vector<Range> new_late_;
  std::uint64_t late_ = 0;
  std::uint64_t lost_ = 0;
  std::uint64_t refused_ = 0;
  std::optional<std::int64_t> last_time_ns_;
};

}  // namespace orbbuf
