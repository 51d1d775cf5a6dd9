// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <vector>

#include "common/frame.hpp"

namespace orbbuf {

/// What a policy sees: the frames that wait, and the frame handed to the network before them.
struct BufferView {
  /// The left neighbour of waiting.front() in what the server receives: the frame last handed to
  /// the network. Null until there is one.
  FramePtr previous;
  /// Oldest first. The last is the newest arrival, which is never the victim.
  std::vector<FramePtr> waiting;

  /// The frame before waiting[i]. May be null for i = 0.
  const FramePtr& left_of(std::size_t i) const { return i == 0 ? previous : waiting[i - 1]; }

  /// The time between the neighbours of waiting[i], which is not the newest. -1 if there is no left
  /// neighbour. Never negative otherwise, also where the clock was set back: a policy would
  /// otherwise give up all frames around such a step of the clock.
  std::int64_t gap_without(std::size_t i) const {
    const FramePtr& left = left_of(i);
    return left ? std::abs(waiting[i + 1]->capture_time_ns - left->capture_time_ns) : -1;
  }

  /// Releases the frames, and keeps the memory of the list.
  void clear() {
    previous.reset();
    waiting.clear();
  }
};

/// Chooses the frame to give up when the buffer is full (paper, Sec. III-D and III-F). Thread-bound
/// to `worker`. Called without a lock. During a call `worker` encodes no frame, and of the frames
/// that are captured meanwhile only the mailbox's newest are kept: so no call may take much longer
/// than the time from one frame to the next.
class DropPolicy {
 public:
  virtual ~DropPolicy() = default;

  /// Does one unit of the work that victim() would do on this view; called when `worker` has
  /// nothing else to do. True if more work remains, for the next call. Requires two frames
  /// waiting.
  virtual bool prepare(const BufferView& /*view*/) { return false; }

  /// The index in view.waiting of the frame to give up, never the last. Requires two frames
  /// waiting.
  virtual std::size_t victim(const BufferView& view) = 0;

  /// M of the neighbours of the last victim, if the policy computed it.
  virtual std::optional<int> last_score() const { return std::nullopt; }
};

}  // namespace orbbuf
