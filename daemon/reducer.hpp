// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <stop_token>
#include <thread>

#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/image/requantiser.hpp"

namespace orbbuf {

/// Makes the frames smaller that the buffer will probably send next (FrameBuffer::next_to_reduce),
/// on a thread of its own, `reducer`: neither capture nor the network waits for it. It waits, at no
/// cost, while the link carries whole frames.
class Reducer {
 public:
  /// `buffer` must outlive it. changed: called on `reducer` when a frame is ready.
  Reducer(FrameBuffer& buffer, std::function<void()> changed);
  /// Ends the frame at hand, and joins.
  ~Reducer() = default;

 private:
  void work(const std::stop_token& stop);

  FrameBuffer& buffer_;
  const std::function<void()> changed_;
  Requantiser requantiser_;  // reducer only
  std::jthread thread_;
};

}  // namespace orbbuf
