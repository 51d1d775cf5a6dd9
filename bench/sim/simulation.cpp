// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/simulation.hpp"

#include <algorithm>
#include <chrono>
#include <limits>
#include <optional>
#include <utility>

#include "common/drop_record.hpp"
#include "daemon/net/link_rate.hpp"

namespace orbbuf::sim {
namespace {

class Simulation {
 public:
  Simulation(const FinishTime& link, SimulatedBuffer parts)
      : link_(link),
        admits_(std::move(parts.admits)),
        stand_ins_(parts.stand_ins),
        believed_rate_(parts.believed_rate),
        buffer_(parts.limits, std::move(parts.policy), std::move(parts.planner)) {}

  void arrive(const FramePtr& frame) {
    const std::int64_t now_ns = frame->capture_time_ns;
    run_link_until(now_ns);
    buffer_.on_captured();
    if (admits_ && !admits_(buffer_.stats().waiting - 1)) {
      buffer_.on_lost({frame->sequence, now_ns, DropReason::kBusy, kUnknownSimilarity});
    } else {
      buffer_.push(stand_ins_ ? (*stand_ins_)[frame->sequence] : frame);
    }
    delivery_.drops_after.push_back(dropped());
    free_at_ns_ = std::max(free_at_ns_, now_ns);
    run_link_until(now_ns);
    while (buffer_.prepare()) {
    }
  }

  Delivery finish() {
    run_link_until(std::numeric_limits<std::int64_t>::max());
    return std::move(delivery_);
  }

 private:
  static LinkRate::Time time(std::int64_t ns) {
    return LinkRate::Time(std::chrono::nanoseconds(ns));
  }

  std::size_t dropped() const {
    const wire::Stats stats = buffer_.stats();
    return stats.dropped + stats.skipped;
  }

  void run_link_until(std::int64_t now_ns) {
    while (free_at_ns_ <= now_ns) {
      const SendMoment moment{std::chrono::nanoseconds(free_at_ns_),
                              believed_rate_ * rate_.bytes_per_s(), std::nullopt};
      const FramePtr frame = buffer_.take(moment);
      if (!frame) return;
      const std::int64_t begin_ns = free_at_ns_;
      delivery_.received.push_back(frame->sequence);
      delivery_.drops_before.push_back(dropped());
      delivery_.begin_ns.push_back(begin_ns);
      free_at_ns_ = link_(begin_ns, frame->jpeg.size());
      delivery_.end_ns.push_back(free_at_ns_);
      rate_.on_written(time(begin_ns), frame->sequence, frame->jpeg.size());
      rate_.on_received(time(free_at_ns_), frame->sequence + 1, std::chrono::nanoseconds(0));
      buffer_.acknowledge(frame->sequence + 1);
    }
  }

  const FinishTime& link_;
  const std::function<bool(std::size_t)> admits_;
  const std::vector<FramePtr>* const stand_ins_;
  const double believed_rate_;
  FrameBuffer buffer_;
  LinkRate rate_;
  Delivery delivery_;
  std::int64_t free_at_ns_ = 0;
};

}  // namespace

Delivery simulate(const std::vector<FramePtr>& frames, const FinishTime& finish,
                  SimulatedBuffer buffer) {
  Simulation simulation(finish, std::move(buffer));
  for (const FramePtr& frame : frames) simulation.arrive(frame);
  return simulation.finish();
}

Delivery simulate(const std::vector<FramePtr>& frames, const LinkModel& link,
                  SimulatedBuffer buffer) {
  const FinishTime finish = [&link](std::int64_t start_ns, std::size_t bytes) {
    return link.finish(start_ns, bytes);
  };
  return simulate(frames, finish, std::move(buffer));
}

}  // namespace orbbuf::sim
