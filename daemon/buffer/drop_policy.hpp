// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <optional>
#include <vector>

#include "common/frame.hpp"

namespace orbbuf {

/// What a policy judges by: the frames that wait, and the one handed to the network before them.
struct BufferView {
  /// The left neighbour of waiting.front() in what the server receives: the frame last handed to
  /// the network. Null until there is one.
  FramePtr previous;
  /// Oldest first. The last is the newest arrival, which is never the victim.
  std::vector<FramePtr> waiting;

  /// The frame that would be followed by waiting[i + 1] if waiting[i] went. May be null for i = 0.
  const FramePtr& left_of(std::size_t i) const { return i == 0 ? previous : waiting[i - 1]; }

  /// The time between frames that giving up waiting[i] would leave; any but the newest. Negative if
  /// there is no frame on the left, so that nothing is torn apart. Otherwise it is not, even where
  /// the clock was set back: else everything around such a place would be given up.
  std::int64_t gap_without(std::size_t i) const {
    const FramePtr& left = left_of(i);
    return left ? std::abs(waiting[i + 1]->capture_time_ns - left->capture_time_ns) : -1;
  }

  /// Lets go of the frames, not of the memory that lists them.
  void clear() {
    previous.reset();
    waiting.clear();
  }
};

/// Who goes when the buffer is full (paper, Sec. III-D and III-F). Thread-bound to `worker`. Runs
/// outside every lock, but while it thinks no frame is encoded, and all but the last of those
/// captured meanwhile are lost: so neither call may take much longer than a frame's own time.
class DropPolicy {
 public:
  virtual ~DropPolicy() = default;

  /// Nothing has to go, and `worker` has nothing else to do: one unit of the work that victim()
  /// would have to do on this view. True if more remains, for the next call. Requires two frames
  /// waiting.
  virtual bool prepare(const BufferView& /*view*/) { return false; }

  /// The index in view.waiting of the frame to give up, never the last. Requires two frames
  /// waiting.
  virtual std::size_t victim(const BufferView& view) = 0;

  /// M of the two frames that giving up victim()'s last answer makes neighbours, if it looked.
  virtual std::optional<int> last_score() const { return std::nullopt; }
};

}  // namespace orbbuf
