// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "daemon/buffer/drop_policy.hpp"

namespace orbbuf::sim {

/// A baseline, for the simulator only: thinning by the count of frames, by the authors of the
/// paper. Source: Wang et al., "AFR: An Efficient Buffering Algorithm for Cloud Robotic Systems",
/// IROS 2022, arXiv:1909.03218 (2019 under the name OptSample).
///
/// Of the arrivals only every level-th is let in. When one is let in and the buffer is full, the
/// frame at the delete position goes, and the position moves on by one; so a sweep from the oldest
/// to the newest deletes every other frame. At the end of a sweep the level doubles, since what is
/// left is twice as far apart, and the next sweep begins at the oldest. The level halves with each
/// arrival that finds the buffer at most two thirds full. A frame sent moves the position back by
/// one with the frames it points to.
///
/// It refuses frames on arrival, also such as find room, which a DropPolicy cannot: the owner of
/// the buffer must ask admits() before each push.
class AfrPolicy final : public DropPolicy {
 public:
  explicit AfrPolicy(std::size_t capacity) : capacity_(capacity) {}

  /// A frame arrives and finds `waiting` others. False: it is to be dropped, not pushed.
  bool admits(std::size_t waiting);

  std::size_t victim(const BufferView& view) override;

 private:
  const std::size_t capacity_;
  std::size_t level_ = 1;
  std::size_t skipped_ = 0;      // arrivals since the last that was let in
  std::size_t position_ = 0;     // of the next to delete
  std::size_t left_behind_ = 0;  // how many waited after the last arrival
};

}  // namespace orbbuf::sim
