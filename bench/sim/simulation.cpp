// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/simulation.hpp"

#include <algorithm>
#include <chrono>
#include <limits>
#include <optional>
#include <stop_token>
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
        reduced_bytes_(std::move(parts.reduced_bytes)),
        encode_quality_(std::move(parts.encode_quality)),
        encoded_bytes_(std::move(parts.encoded_bytes)),
        believed_rate_(parts.believed_rate),
        buffer_(parts.limits, std::move(parts.policy), std::move(parts.planner)) {
    stopped_.request_stop();
    if (reduced_bytes_) buffer_.expect_reductions();
  }

  void arrive(const FramePtr& frame) {
    const std::int64_t now_ns = frame->capture_time_ns;
    run_link_until(now_ns);
    buffer_.on_captured();
    if (admits_ && !admits_(buffer_.stats().waiting - 1)) {
      buffer_.on_lost({frame->sequence, now_ns, DropReason::kBusy, kUnknownSimilarity});
    } else {
      buffer_.push(encode(stand_ins_ ? (*stand_ins_)[frame->sequence] : frame));
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

  static FramePtr resized(const EncodedFrame& frame, int quality, std::size_t bytes) {
    EncodedFrame copy = frame;
    copy.quality = static_cast<std::uint8_t>(quality);
    copy.jpeg.resize(bytes);
    return std::make_shared<const EncodedFrame>(std::move(copy));
  }

  FramePtr encode(const FramePtr& frame) const {
    if (!encoded_bytes_) return frame;
    const int quality = encode_quality_
                            ? encode_quality_(buffer_.report().waiting_bytes, rate_.bytes_per_s())
                            : buffer_.encode_quality().value_or(frame->quality);
    if (quality >= frame->quality) return frame;
    return resized(*frame, quality, encoded_bytes_(frame->sequence, quality));
  }

  void reduce() {
    while (const auto job = buffer_.next_to_reduce(stopped_.get_token())) {
      const std::size_t bytes = reduced_bytes_(job->whole->sequence, job->quality);
      buffer_.on_reduced(*job, resized(*job->whole, job->quality, bytes));
    }
  }

  FramePtr take() {
    SendMoment moment{
        std::chrono::nanoseconds(free_at_ns_),
        believed_rate_ * rate_.bytes_per_s(time(free_at_ns_), std::chrono::nanoseconds(0))};
    if (!reduced_bytes_) return buffer_.take(moment);
    moment.is_busy = true;
    if (FramePtr frame = buffer_.take(moment)) return frame;
    reduce();
    moment.is_busy = false;
    return buffer_.take(moment);
  }

  /// The robot replaces a connection on which nothing moves for link.stall_timeout, and what was on
  /// its way then tells nothing of the rate.
  bool has_stalled(std::int64_t begin_ns, std::size_t bytes) const {
    constexpr std::int64_t kStallTimeoutNs = 300'000'000;
    constexpr std::size_t kParts = 16;
    if (free_at_ns_ - begin_ns < kStallTimeoutNs) return false;
    std::int64_t before_ns = begin_ns;
    for (std::size_t part = 1; part <= kParts; ++part) {
      const std::int64_t end_ns = link_(begin_ns, bytes * part / kParts);
      if (end_ns - std::exchange(before_ns, end_ns) > kStallTimeoutNs) return true;
    }
    return false;
  }

  std::size_t dropped() const {
    const wire::Stats stats = buffer_.stats();
    return stats.dropped + stats.skipped;
  }

  void run_link_until(std::int64_t now_ns) {
    while (free_at_ns_ <= now_ns) {
      const FramePtr frame = take();
      if (!frame) return;
      const std::int64_t begin_ns = free_at_ns_;
      delivery_.received.push_back(frame->sequence);
      delivery_.quality.push_back(frame->quality);
      delivery_.bytes.push_back(frame->jpeg.size());
      delivery_.drops_before.push_back(dropped());
      delivery_.begin_ns.push_back(begin_ns);
      free_at_ns_ = link_(begin_ns, frame->jpeg.size());
      delivery_.end_ns.push_back(free_at_ns_);
      rate_.on_written(time(begin_ns), frame->sequence, frame->jpeg.size());
      if (has_stalled(begin_ns, frame->jpeg.size())) rate_.on_lost();
      rate_.on_received(time(free_at_ns_), frame->sequence + 1, std::chrono::nanoseconds(0));
      buffer_.acknowledge(frame->sequence + 1);
    }
  }

  const FinishTime& link_;
  const std::function<bool(std::size_t)> admits_;
  const std::vector<FramePtr>* const stand_ins_;
  const BytesAt reduced_bytes_;
  const std::function<int(std::uint64_t, double)> encode_quality_;
  const BytesAt encoded_bytes_;
  const double believed_rate_;
  std::stop_source stopped_;
  FrameBuffer buffer_;
  LinkRate rate_;
  Delivery delivery_;
  std::int64_t free_at_ns_ = 0;
};

}  // namespace

std::optional<double> live_again_s(std::span<const FramePtr> captured,
                                   std::span<const std::size_t> sent,
                                   std::span<const std::int64_t> begin_ns, std::int64_t return_ns) {
  for (std::size_t k = 0; k < sent.size(); ++k) {
    if (begin_ns[k] < return_ns) continue;
    const std::size_t next = sent[k] + 1;
    if (next >= captured.size() || captured[next]->capture_time_ns >= begin_ns[k]) {
      return to_s(begin_ns[k] - return_ns);
    }
  }
  return std::nullopt;
}

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
