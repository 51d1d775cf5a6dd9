// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/simulation.hpp"

#include <cstdint>
#include <limits>
#include <utility>

#include "daemon/buffer/frame_buffer.hpp"

namespace orbbuf::sim {
namespace {

class Simulation {
 public:
  Simulation(const FinishTime& link, std::size_t capacity, std::unique_ptr<DropPolicy> policy)
      : link_(link), buffer_({capacity}, std::move(policy)) {}

  void arrive(const FramePtr& frame) {
    run_link_until(frame->capture_time_ns);
    buffer_.captured();
    buffer_.push(frame);
    delivery_.drops_after.push_back(buffer_.stats().dropped);
    free_at_ns_ = std::max(free_at_ns_, frame->capture_time_ns);
    run_link_until(frame->capture_time_ns);
    while (buffer_.prepare()) {
    }
  }

  Delivery finish() {
    run_link_until(std::numeric_limits<std::int64_t>::max());
    return std::move(delivery_);
  }

 private:
  void run_link_until(std::int64_t now_ns) {
    while (free_at_ns_ <= now_ns) {
      const FramePtr frame = buffer_.take();
      if (!frame) return;
      delivery_.received.push_back(frame->sequence);
      delivery_.drops_before.push_back(buffer_.stats().dropped);
      free_at_ns_ = link_(free_at_ns_, frame->jpeg.size());
      buffer_.acknowledge(frame->sequence + 1);
    }
  }

  const FinishTime& link_;
  FrameBuffer buffer_;
  Delivery delivery_;
  std::int64_t free_at_ns_ = 0;
};

}  // namespace

Delivery simulate(const std::vector<FramePtr>& frames, const LinkModel& link, std::size_t capacity,
                  std::unique_ptr<DropPolicy> policy) {
  const FinishTime finish = [&link](std::int64_t start_ns, std::size_t bytes) {
    return link.finish(start_ns, bytes);
  };
  return simulate(frames, finish, capacity, std::move(policy));
}

Delivery simulate(const std::vector<FramePtr>& frames, const FinishTime& finish,
                  std::size_t capacity, std::unique_ptr<DropPolicy> policy) {
  Simulation simulation(finish, capacity, std::move(policy));
  for (const FramePtr& frame : frames) simulation.arrive(frame);
  return simulation.finish();
}

}  // namespace orbbuf::sim
