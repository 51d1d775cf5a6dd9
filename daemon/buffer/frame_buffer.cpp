// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/frame_buffer.hpp"

#include <algorithm>
#include <cassert>
#include <stdexcept>
#include <string>
#include <utility>

#include "common/watched_thread.hpp"

namespace orbbuf {
namespace {

DropRecord record_of(const EncodedFrame& frame, DropReason reason,
                     std::uint16_t similarity = kUnknownSimilarity) {
  return {frame.sequence, frame.capture_time_ns, reason, similarity};
}

std::uint16_t to_similarity(std::optional<int> score) {
  return score ? static_cast<std::uint16_t>(std::clamp(*score, 0, kUnknownSimilarity - 1))
               : kUnknownSimilarity;
}

}  // namespace

FrameBuffer::FrameBuffer(std::size_t capacity, std::unique_ptr<DropPolicy> policy)
    : capacity_(capacity), policy_(std::move(policy)) {
  if (capacity_ < 3) {
    throw std::invalid_argument("buffer capacity " + std::to_string(capacity_) +
                                " is less than 3 frames");
  }
  assert(policy_);
  waiting_.reserve(capacity_ + 1);
  view_.waiting.reserve(capacity_ + 1);
}

void FrameBuffer::captured() {
  const std::lock_guard lock(mutex_);
  ++counts_.captured;
  ++entering_;
}

void FrameBuffer::lost(const DropRecord& record) {
  const std::lock_guard lock(mutex_);
  assert(entering_ > 0 && record.reason != DropReason::kPolicy);
  --entering_;
  switch (record.reason) {
    case DropReason::kBusy:
      ++counts_.skipped;
      break;
    case DropReason::kFailed:
      ++counts_.failed;
      break;
    case DropReason::kPolicy:
    case DropReason::kShutdown:
      ++counts_.dropped;
      break;
  }
  final_drops_.push_back(record);
}

void FrameBuffer::push(FramePtr frame) {
  std::unique_lock lock(mutex_);
  assert(entering_ > 0);
  assert(waiting_.empty() || waiting_.back().frame->sequence < frame->sequence);
  --entering_;
  // First of all the network may have it: what the policy thinks about must not delay the link.
  waiting_.push_back({std::move(frame)});
  while (waiting_.size() > capacity_) {
    update_view();
    lock.unlock();
    const std::size_t choice = policy_->victim(view_);
    assert(choice + 1 < view_.waiting.size());
    lock.lock();
    // The network went on meanwhile: there may be room now, or the victim may be on its way.
    if (waiting_.size() > capacity_) {
      drop_if_waiting({view_.waiting[choice], to_similarity(policy_->last_score())});
    }
  }
  lock.unlock();
  view_.clear();
}

bool FrameBuffer::prepare() {
  std::unique_lock lock(mutex_);
  if (waiting_.size() < 2) return false;
  update_view();
  lock.unlock();
  const bool is_more = policy_->prepare(view_);
  view_.clear();
  return is_more;
}

bool FrameBuffer::wait_for_room(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  return wait_beating(room_, lock, stop, [this] { return waiting_.size() < capacity_; });
}

FramePtr FrameBuffer::take() {
  const std::lock_guard lock(mutex_);
  if (waiting_.empty()) return nullptr;
  in_flight_.push_back(std::move(waiting_.front().frame));
  waiting_.erase(waiting_.begin());
  room_.notify_all();
  return in_flight_.back();
}

void FrameBuffer::acknowledge(Sequence next) {
  const std::lock_guard lock(mutex_);
  auto first = in_flight_.begin();
  for (; first != in_flight_.end() && (*first)->sequence < next; ++first) {
    count_delivered(std::move(*first));
  }
  in_flight_.erase(in_flight_.begin(), first);
}

void FrameBuffer::return_in_flight() {
  const std::lock_guard lock(mutex_);
  waiting_.insert(waiting_.begin(), in_flight_.size(), {});
  std::ranges::transform(in_flight_, waiting_.begin(), [](FramePtr& frame) {
    return Entry{std::move(frame), true};
  });
  in_flight_.clear();
}

// A connection writes frames in the order of their sequence numbers and the server takes them in
// the order they come. So a server that expects `next` has all below it that any connection ever
// wrote, and none from there on: one number settles every frame that was taken and returned.
void FrameBuffer::resume(Sequence next) {
  const std::lock_guard lock(mutex_);
  assert(in_flight_.empty());
  // Frames that were taken are older than all that were not, so they are first in line.
  auto first = waiting_.begin();
  for (; first != waiting_.end() && first->was_taken && first->frame->sequence < next; ++first) {
    count_delivered(std::move(first->frame));
  }
  waiting_.erase(waiting_.begin(), first);
  for (Entry& entry : waiting_) entry.was_taken = false;
  for (auto& [frame, similarity] : unconfirmed_drops_) {
    if (frame->sequence < next) {
      --counts_.dropped;
      count_delivered(std::move(frame));
    } else {
      final_drops_.push_back(record_of(*frame, DropReason::kPolicy, similarity));
    }
  }
  unconfirmed_drops_.clear();
  room_.notify_all();
}

void FrameBuffer::collect_drops(std::vector<DropRecord>& drops) {
  drops.clear();
  const std::lock_guard lock(mutex_);
  drops.swap(final_drops_);
}

void FrameBuffer::give_up_waiting() {
  const std::lock_guard lock(mutex_);
  const auto first = std::ranges::find(waiting_, false, &Entry::was_taken);
  for (auto entry = first; entry != waiting_.end(); ++entry) {
    final_drops_.push_back(record_of(*entry->frame, DropReason::kShutdown));
    ++counts_.dropped;
  }
  waiting_.erase(first, waiting_.end());
  room_.notify_all();
}

void FrameBuffer::give_up() {
  const std::lock_guard lock(mutex_);
  for (const auto& [frame, similarity] : unconfirmed_drops_) {
    final_drops_.push_back(record_of(*frame, DropReason::kPolicy, similarity));
  }
  for (const FramePtr& frame : in_flight_) {
    final_drops_.push_back(record_of(*frame, DropReason::kShutdown));
  }
  for (const Entry& entry : waiting_) {
    final_drops_.push_back(record_of(*entry.frame, DropReason::kShutdown));
  }
  counts_.dropped += in_flight_.size() + waiting_.size();
  unconfirmed_drops_.clear();
  in_flight_.clear();
  waiting_.clear();
  room_.notify_all();
}

wire::Stats FrameBuffer::stats() const {
  const std::lock_guard lock(mutex_);
  return account();
}

wire::Report FrameBuffer::report() const {
  const std::lock_guard lock(mutex_);
  wire::Report report{account(), static_cast<std::uint32_t>(capacity_)};
  for (const Entry& entry : waiting_) report.waiting_bytes += entry.frame->jpeg.size();
  return report;
}

wire::Stats FrameBuffer::account() const {
  wire::Stats stats = counts_;
  stats.waiting = waiting_.size() + entering_;
  stats.in_flight = in_flight_.size();
  return stats;
}

void FrameBuffer::update_view() {
  view_.previous = in_flight_.empty() ? last_acknowledged_ : in_flight_.back();
  view_.waiting.clear();
  for (const Entry& entry : waiting_) view_.waiting.push_back(entry.frame);
}

void FrameBuffer::drop_if_waiting(const Drop& victim) {
  const auto entry = std::ranges::find(waiting_, victim.frame, &Entry::frame);
  if (entry == waiting_.end()) return;
  ++counts_.dropped;
  if (entry->was_taken) {
    unconfirmed_drops_.push_back(victim);
  } else {
    final_drops_.push_back(record_of(*victim.frame, DropReason::kPolicy, victim.similarity));
  }
  waiting_.erase(entry);
}

void FrameBuffer::count_delivered(FramePtr frame) {
  ++counts_.acknowledged;
  if (!last_acknowledged_ || last_acknowledged_->sequence < frame->sequence) {
    last_acknowledged_ = std::move(frame);
  }
}

}  // namespace orbbuf
