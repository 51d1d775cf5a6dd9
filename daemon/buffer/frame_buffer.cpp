// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/frame_buffer.hpp"

#include <algorithm>
#include <cassert>
#include <iterator>
#include <stdexcept>
#include <string>
#include <utility>

#include "common/watched_thread.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kMostReserved = 1000;  // frames; more make the lists grow
constexpr double kWorthWaitingS = 0.02;  // of the link's time: a frame may be made smaller first

DropRecord record_of(const EncodedFrame& frame, DropReason reason,
                     std::uint16_t similarity = kUnknownSimilarity) {
  return {frame.sequence, frame.capture_time_ns, reason, similarity};
}

std::uint16_t to_similarity(std::optional<int> score) {
  return score ? static_cast<std::uint16_t>(std::clamp(*score, 0, kUnknownSimilarity - 1))
               : kUnknownSimilarity;
}

}  // namespace

FrameBuffer::FrameBuffer(BufferLimits limits, std::unique_ptr<DropPolicy> policy,
                         std::unique_ptr<SendPlanner> planner)
    : limits_(limits), policy_(std::move(policy)), planner_(std::move(planner)) {
  if (limits_.frames < 3) {
    throw std::invalid_argument("buffer capacity " + std::to_string(limits_.frames) +
                                " is less than 3 frames");
  }
  assert(policy_);
  const std::size_t expected = std::min(limits_.frames, kMostReserved);
  waiting_.reserve(expected + 1);
  view_.waiting.reserve(expected + 1);
  delivered_.reserve(kMostRemembered);
}

void FrameBuffer::on_captured() {
  const std::lock_guard lock(mutex_);
  ++counts_.captured;
  ++entering_;
}

void FrameBuffer::on_lost(const DropRecord& record) {
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
    case DropReason::kRefused:
    case DropReason::kUnknown:
    case DropReason::kLost:
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
  // Add the frame first, so that the network can take it while the policy runs.
  waiting_bytes_ += frame->jpeg.size();
  const double position_s = next_position(*frame);
  waiting_.push_back({std::move(frame), position_s});
  while (!limits_.is_waited_for && is_over_limit()) {
    update_view();
    lock.unlock();
    const std::size_t choice = policy_->victim(view_);
    assert(choice + 1 < view_.waiting.size());
    lock.lock();
    // The network took frames meanwhile: there may be room now, or the victim may be in flight.
    if (is_over_limit()) {
      drop_if_waiting(view_.waiting[choice], to_similarity(policy_->last_score()));
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
  return wait_beating(room_, lock, stop, [this] {
    return waiting_.size() < limits_.frames && waiting_bytes_ + in_flight_bytes_ < limits_.bytes;
  });
}

FramePtr FrameBuffer::take(const SendMoment& moment) {
  const std::lock_guard lock(mutex_);
  if (waiting_.empty() || !may_take()) return nullptr;
  auto choices = planner_ ? choose(moment) : SendPlanner::Choices(1);
  const auto chosen = waiting_.begin() + static_cast<std::ptrdiff_t>(choices.front().index);
  FramePtr frame = version_of(choices.front(), moment);
  if (frame) choices.erase(choices.begin());
  want_reductions(choices);
  if (!frame) return nullptr;
  for (auto passed = waiting_.begin(); passed != chosen; ++passed) {
    drop(*passed, kUnknownSimilarity);
  }
  chosen->was_reduced = frame->is_reduced();
  waiting_bytes_ -= chosen->frame->jpeg.size();
  in_flight_bytes_ += chosen->frame->jpeg.size();
  in_flight_.push_back(std::move(*chosen));
  waiting_.erase(waiting_.begin(), chosen + 1);
  if (planner_) planner_->on_sent(frame->jpeg.size(), moment);
  room_.notify_all();
  return frame;
}

void FrameBuffer::look_ahead(const SendMoment& moment) {
  const std::lock_guard lock(mutex_);
  if (!planner_ || waiting_.empty() || !has_reducer_) return;
  want_reductions(planner_->look_ahead(last_position(), plan_waiting(), moment));
}

void FrameBuffer::expect_reductions() {
  const std::lock_guard lock(mutex_);
  has_reducer_ = true;
}

std::optional<Reductions::Job> FrameBuffer::next_to_reduce(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  wait_beating(reductions_wanted_, lock, stop, [this] { return reductions_.is_wanting(); });
  return reductions_.next();
}

void FrameBuffer::on_reduced(const Reductions::Job& job, FramePtr reduced) {
  const std::lock_guard lock(mutex_);
  if (reduced) {
    planner_->on_reduced({0, job.whole->jpeg.size(), job.whole->quality}, reduced->jpeg.size(),
                         job.quality);
  } else {
    ++irreducible_;
  }
  reductions_.on_made(job, std::move(reduced));
}

std::optional<int> FrameBuffer::encode_quality() const {
  const std::lock_guard lock(mutex_);
  return planner_ ? std::optional(planner_->encode_quality()) : std::nullopt;
}

void FrameBuffer::refuse_newest() {
  const std::lock_guard lock(mutex_);
  assert(!in_flight_.empty());
  const EncodedFrame& frame = *in_flight_.back().frame;
  final_drops_.push_back(record_of(frame, DropReason::kRefused));
  if (in_flight_.back().is_kept) for_record_.delivered.push_back(frame.sequence);  // no use
  in_flight_bytes_ -= frame.jpeg.size();
  in_flight_.pop_back();
  ++counts_.dropped;
  room_.notify_all();
}

void FrameBuffer::acknowledge(Sequence next) {
  const std::lock_guard lock(mutex_);
  auto first = in_flight_.begin();
  for (; first != in_flight_.end() && first->frame->sequence < next; ++first) {
    in_flight_bytes_ -= first->frame->jpeg.size();
    count_delivered(*first);
  }
  in_flight_.erase(in_flight_.begin(), first);
  room_.notify_all();
}

void FrameBuffer::return_in_flight() {
  const std::lock_guard lock(mutex_);
  for (Entry& entry : in_flight_) {
    entry.was_taken = true;
  }
  waiting_bytes_ += std::exchange(in_flight_bytes_, 0);
  waiting_.insert(waiting_.begin(), std::make_move_iterator(in_flight_.begin()),
                  std::make_move_iterator(in_flight_.end()));
  in_flight_.clear();
}

// A connection writes frames in the order of their sequence numbers, and the server takes them in
// that order. So a server that expects `next` has all frames below it that any connection ever
// wrote, and none from there on: one number decides about every returned frame.
void FrameBuffer::resume(Sequence next) {
  const std::lock_guard lock(mutex_);
  assert(in_flight_.empty());
  lose_delivered(next);
  // Frames that were taken are older than all that were not, so they are first in line.
  auto first = waiting_.begin();
  for (; first != waiting_.end() && first->was_taken && first->frame->sequence < next; ++first) {
    waiting_bytes_ -= first->frame->jpeg.size();
    count_delivered(*first);
  }
  waiting_.erase(waiting_.begin(), first);
  for (Entry& entry : waiting_) entry.was_taken = false;
  for (auto& [entry, similarity] : unconfirmed_drops_) {
    if (entry.frame->sequence < next) {
      --counts_.dropped;
      count_delivered(entry);
    } else {
      final_drops_.push_back(record_of(*entry.frame, DropReason::kPolicy, similarity));
      keep(entry);
    }
  }
  unconfirmed_drops_.clear();
  room_.notify_all();
}

void FrameBuffer::collect_for_record(ForRecord& record, bool those_at_risk) {
  record.frames.clear();
  record.delivered.clear();
  const std::lock_guard lock(mutex_);
  if (those_at_risk) {
    for (auto* const entries : {&in_flight_, &waiting_}) {
      for (Entry& entry : *entries) {
        if (std::exchange(entry.is_old, true)) keep(entry);
      }
    }
    for (auto& [entry, similarity] : unconfirmed_drops_) {
      if (std::exchange(entry.is_old, true)) keep(entry);
    }
  }
  std::swap(record, for_record_);
  record.first_undelivered = first_undelivered();
}

Sequence FrameBuffer::first_undelivered() const {
  if (!in_flight_.empty()) return in_flight_.front().frame->sequence;
  if (!waiting_.empty()) return waiting_.front().frame->sequence;
  return std::numeric_limits<Sequence>::max();
}

/// For the record: an entry whose frame is moved elsewhere afterwards, or which stays.
void FrameBuffer::keep(Entry& entry) {
  if (has_record_ && !std::exchange(entry.is_kept, true)) for_record_.frames.push_back(entry.frame);
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
    keep(*entry);
    final_drops_.push_back(record_of(*entry->frame, DropReason::kShutdown));
    waiting_bytes_ -= entry->frame->jpeg.size();
    ++counts_.dropped;
  }
  waiting_.erase(first, waiting_.end());
  room_.notify_all();
}

void FrameBuffer::give_up() {
  const std::lock_guard lock(mutex_);
  for (auto& [entry, similarity] : unconfirmed_drops_) {
    keep(entry);
    final_drops_.push_back(record_of(*entry.frame, DropReason::kPolicy, similarity));
  }
  for (Entry& entry : in_flight_) {
    keep(entry);
    final_drops_.push_back(record_of(*entry.frame, DropReason::kUnknown));
  }
  for (Entry& entry : waiting_) {
    keep(entry);
    const auto reason = entry.was_taken ? DropReason::kUnknown : DropReason::kShutdown;
    final_drops_.push_back(record_of(*entry.frame, reason));
  }
  counts_.dropped += in_flight_.size() + waiting_.size();
  unconfirmed_drops_.clear();
  in_flight_.clear();
  waiting_.clear();
  waiting_bytes_ = in_flight_bytes_ = 0;
  room_.notify_all();
}

wire::Stats FrameBuffer::stats() const {
  const std::lock_guard lock(mutex_);
  return current_stats();
}

wire::Report FrameBuffer::report() const {
  const std::lock_guard lock(mutex_);
  std::size_t capacity = limits_.frames;
  if (planner_ && planner_->mean_bytes() > 0) {
    const double frames = static_cast<double>(limits_.bytes) / planner_->mean_bytes();
    capacity = std::min(capacity, static_cast<std::size_t>(frames));
  }
  constexpr std::size_t kMost = std::numeric_limits<std::uint32_t>::max();
  wire::Report report;
  report.stats = current_stats();
  report.capacity = static_cast<std::uint32_t>(std::min(capacity, kMost));
  report.waiting_bytes = waiting_bytes_;
  report.irreducible = irreducible_;
  return report;
}

std::int64_t FrameBuffer::last_capture_time_ns() const {
  const std::lock_guard lock(mutex_);
  return last_capture_time_ns_.value_or(0);
}

wire::Stats FrameBuffer::current_stats() const {
  wire::Stats stats = counts_;
  stats.waiting = waiting_.size() + entering_;
  stats.in_flight = in_flight_.size();
  return stats;
}

bool FrameBuffer::is_over_limit() const {
  return waiting_.size() > limits_.frames ||
         (waiting_bytes_ + in_flight_bytes_ > limits_.bytes && waiting_.size() > 1);
}

bool FrameBuffer::may_take() const {
  if (in_flight_.size() < 2) return true;  // one is sent while the next one waits
  return in_flight_.size() < std::max(limits_.frames, kMostInFlight) &&
         in_flight_bytes_ < limits_.bytes / 2;
}

/// If the capture time goes back, the position stays the same for this frame.
double FrameBuffer::next_position(const EncodedFrame& frame) {
  const std::int64_t time_ns = frame.capture_time_ns;
  const std::int64_t step_ns = time_ns - last_capture_time_ns_.value_or(time_ns);
  last_capture_time_ns_ = time_ns;
  const double step_s = 1e-9 * static_cast<double>(std::max<std::int64_t>(0, step_ns));
  if (planner_) planner_->on_captured(step_s, {0, frame.jpeg.size(), frame.quality});
  return last_position_s_ += step_s;
}

/// Of the frame before the waiting ones.
std::optional<double> FrameBuffer::last_position() const {
  const Entry& last = in_flight_.empty() ? last_acknowledged_ : in_flight_.back();
  return last.frame ? std::optional(last.position_s) : std::nullopt;
}

std::span<const PlannedFrame> FrameBuffer::plan_waiting() {
  planned_.clear();
  for (const Entry& entry : waiting_) {
    planned_.push_back({entry.position_s, entry.frame->jpeg.size(), entry.frame->quality});
  }
  return planned_;
}

SendPlanner::Choices FrameBuffer::choose(const SendMoment& moment) {
  return planner_->choose(last_position(), plan_waiting(), moment);
}

/// Null while it is worth while to wait for it.
FramePtr FrameBuffer::version_of(const SendPlanner::Choice& choice,
                                 const SendMoment& moment) const {
  const FramePtr& whole = waiting_[choice.index].frame;
  if (choice.quality == 0) return whole;
  FramePtr reduced = reductions_.reduced(whole);
  if (reduced && planner_->is_close(reduced->quality, choice.quality)) return reduced;
  const FramePtr& best = reduced ? reduced : whole;
  if (!has_reducer_ || reductions_.has_failed(whole)) return best;
  const PlannedFrame planned{0, best->jpeg.size(), best->quality};
  const bool is_worth_it =
      moment.is_busy || planner_->saved_s(planned, choice.quality, moment) > kWorthWaitingS;
  return is_worth_it ? nullptr : best;
}

void FrameBuffer::want_reductions(const SendPlanner::Choices& choices) {
  Reductions::Jobs jobs;
  for (const auto& [index, quality] : choices) {
    if (quality > 0) jobs.push_back({waiting_[index].frame, quality});
  }
  reductions_.want(jobs, [this](int one, int other) { return planner_->is_close(one, other); });
  if (reductions_.is_wanting()) reductions_wanted_.notify_one();
}

void FrameBuffer::update_view() {
  view_.previous = in_flight_.empty() ? last_acknowledged_.frame : in_flight_.back().frame;
  view_.waiting.clear();
  for (const Entry& entry : waiting_) view_.waiting.push_back(entry.frame);
}

void FrameBuffer::drop_if_waiting(const FramePtr& victim, std::uint16_t similarity) {
  const auto entry = std::ranges::find(waiting_, victim, &Entry::frame);
  if (entry == waiting_.end()) return;
  drop(*entry, similarity);
  waiting_.erase(entry);
}

/// Leaves the entry in the list, empty or not.
void FrameBuffer::drop(Entry& entry, std::uint16_t similarity) {
  ++counts_.dropped;
  waiting_bytes_ -= entry.frame->jpeg.size();
  if (entry.was_taken) {
    unconfirmed_drops_.push_back({std::move(entry), similarity});
  } else {
    keep(entry);
    final_drops_.push_back(record_of(*entry.frame, DropReason::kPolicy, similarity));
  }
}

/// Names the frames from `next` on that were acknowledged: the server has lost them.
void FrameBuffer::lose_delivered(Sequence next) {
  const auto by_sequence = [](const Delivered& one, const Delivered& other) {
    return one.sequence < other.sequence;
  };
  const auto is_lost = [next](const Delivered& frame) { return frame.sequence >= next; };
  if (std::none_of(delivered_.begin(), delivered_.end(), is_lost)) return;
  std::sort(delivered_.begin(), delivered_.end(), by_sequence);
  oldest_delivered_ = 0;
  const auto first = std::find_if(delivered_.begin(), delivered_.end(), is_lost);
  for (auto frame = first; frame != delivered_.end(); ++frame) {
    final_drops_.push_back({frame->sequence, frame->capture_time_ns, DropReason::kLost});
    --counts_.acknowledged;
    ++counts_.dropped;
  }
  delivered_.erase(first, delivered_.end());
}

void FrameBuffer::count_delivered(Entry& entry) {
  ++counts_.acknowledged;
  if (entry.was_reduced) {
    keep(entry);
  } else if (entry.is_kept) {
    for_record_.delivered.push_back(entry.frame->sequence);
  }
  const Delivered delivered{entry.frame->sequence, entry.frame->capture_time_ns};
  if (delivered_.size() < kMostRemembered) {
    delivered_.push_back(delivered);
  } else {
    delivered_[oldest_delivered_] = delivered;
    oldest_delivered_ = (oldest_delivered_ + 1) % kMostRemembered;
  }
  if (!last_acknowledged_.frame || last_acknowledged_.frame->sequence < entry.frame->sequence) {
    last_acknowledged_ = std::move(entry);
  }
}

}  // namespace orbbuf
