// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/container/deque.hpp>
#include <cstdint>
#include <vector>

#include "common/frame.hpp"

namespace orbbuf {

/// A frame that is to be sent late, or several items of another stream, and where the journal has
/// it.
struct KeptFrame {
  enum class State : std::uint8_t {
    kPending,  ///< not written yet
    kWritten,
    kTaken,  ///< written, and on its way to the server
    kGone,   ///< not held any more
  };

  Sequence sequence = 0;
  std::uint32_t segment = 0;
  std::uint32_t offset = 0;  ///< of the record in the segment
  std::uint32_t bytes = 0;   ///< of the record
  State state = State::kPending;
  bool is_late = true;      ///< else it is only to be sent if this process dies
  std::uint16_t count = 1;  ///< of numbers, from `sequence` on

  Sequence end() const { return sequence + count; }
};
static_assert(sizeof(KeptFrame) == 24);

/// The frames of one session that the robot holds, or the items of a stream, by number. They come
/// nearly in that order, and leave nearly in that order. Reentrant. Memory: 24 bytes for each from
/// the first to the last.
class KeptFrames {
 public:
  /// False: there is one of that number.
  bool add(const KeptFrame& frame);
  /// Null: it is not held. Valid until the next change.
  KeptFrame* find(Sequence sequence);
  /// A pending one is in the journal now.
  void on_written(KeptFrame& frame, const KeptFrame& place);
  /// The first written one below `end`, which is taken from here on; null: there is none.
  const KeptFrame* take_next(Sequence end);
  /// One that was taken is to be taken again.
  void give_back(KeptFrame& frame);
  void remove(KeptFrame& frame);
  /// The first that is not late and has only numbers below `end`; null: there is none.
  KeptFrame* find_done(Sequence end);
  /// What has any of these numbers is late.
  void set_late(Sequence begin, Sequence end);
  /// Removes those written to `segment`, at most `most` of them, and returns them.
  std::vector<KeptFrame> remove_segment(std::uint32_t segment, std::uint64_t most);

  /// Frames, or single items.
  std::uint64_t held() const { return held_; }
  /// The lowest number; 0 without any.
  Sequence first() const { return frames_.empty() ? 0 : frames_.front().sequence; }

 private:
  using Frames = boost::container::deque<KeptFrame>;  // std::deque takes 576 bytes when it is empty
  Frames::iterator from(Sequence sequence);
  void trim();

  Frames frames_;  // the first and the last are held
  std::uint64_t held_ = 0;
  Sequence next_ = 0;  // no written one is below it
};

}  // namespace orbbuf
