// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_queue.hpp"

#include <algorithm>
#include <cstdlib>
#include <limits>

namespace orbbuf {

namespace {

/// More messages of topics than these do not go together over the link.
constexpr std::size_t kMessagesTogether = std::size_t{64} << 10U;
constexpr std::int64_t kMin = std::numeric_limits<std::int64_t>::min();
constexpr std::int64_t kMax = std::numeric_limits<std::int64_t>::max();
/// A message of a frame may come so many frames later.
constexpr std::size_t kSentFrames = 64;

std::uint64_t message_bytes(const Sample& sample) {
  return sample.message ? sizeof(TopicMessage) + sample.message->cdr.size() : 0;
}

}  // namespace

SampleQueue::SampleQueue(std::uint64_t bytes, TopicPolicy policy,
                         std::chrono::nanoseconds frame_time)
    : most_bytes_(bytes), policy_(policy), half_frame_ns_(frame_time.count() / 2) {}

bool SampleQueue::push(const Sample& sample) {
  const bool is_message = sample.message != nullptr;
  const bool can_be_sent = is_message ? sample.message->cdr.size() <= wire::kMaxTopicMessageBytes
                                      : !last_time_ns_ || sample.time_ns > *last_time_ns_;
  if (!can_be_sent) {
    refuse();
    return false;
  }
  const std::uint64_t bytes = kBytesPerSample + message_bytes(sample);
  const auto has_to_go = [&] {
    return bytes_ + bytes > most_bytes_ ||
           (policy_ == TopicPolicy::kLatest && waiting_.back().number >= sent_end_);
  };
  while (!waiting_.empty() && has_to_go()) make_room();
  last_time_ns_ = sample.time_ns;
  waiting_.push_back({end_++, sample});
  bytes_ += bytes;
  give_up_passed();
  return true;
}

void SampleQueue::refuse() {
  ++end_;
  ++lost_;
  ++refused_;
}

void SampleQueue::on_frame_sent(std::int64_t time_ns) {
  if (policy_ != TopicPolicy::kFrames) return;
  sent_frames_.push_back(time_ns);
  if (sent_frames_.size() > kSentFrames) sent_frames_.pop_front();
  give_up_passed();
}

void SampleQueue::on_frames_dropped(std::int64_t first_ns, std::int64_t last_ns) {
  if (policy_ == TopicPolicy::kFrames) give_up_between(first_ns, last_ns);
}

void SampleQueue::on_last_frame_sent() {
  if (policy_ == TopicPolicy::kFrames) give_up_between(kMin, kMax);
}

/// Those that were sent are few, and the server may have them.
void SampleQueue::make_room() {
  auto victim = std::ranges::lower_bound(waiting_, sent_end_, {}, &Entry::number);
  if (victim == waiting_.end()) {
    victim = waiting_.begin();
    if (sent_ > 0) --sent_;
  }
  give_up(victim);
}

SampleQueue::Entries::iterator SampleQueue::give_up(const Entries::iterator& victim) {
  const std::uint64_t number = victim->number;
  bytes_ -= kBytesPerSample + message_bytes(victim->sample);
  const auto next = waiting_.erase(victim);
  if (number >= recorded_end_) {
    ++lost_;
    return next;
  }
  ++late_;
  if (new_late_.empty() || new_late_.back().end != number) new_late_.push_back({number, number});
  ++new_late_.back().end;
  return next;
}

bool SampleQueue::is_of_sent_frame(const Entry& entry) const {
  return std::ranges::any_of(sent_frames_, [&](std::int64_t time_ns) {
    return std::abs(entry.sample.time_ns - time_ns) <= half_frame_ns_;
  });
}

/// Messages that were never sent and are of no frame that was.
void SampleQueue::give_up_between(std::int64_t first_ns, std::int64_t last_ns) {
  auto entry = std::ranges::lower_bound(waiting_, sent_end_, {}, &Entry::number);
  while (entry != waiting_.end()) {
    const std::int64_t time_ns = entry->sample.time_ns;
    const bool has_to_go = time_ns >= first_ns && time_ns <= last_ns && !is_of_sent_frame(*entry);
    entry = has_to_go ? give_up(entry) : entry + 1;
  }
}

void SampleQueue::give_up_passed() {
  if (sent_frames_.empty()) return;
  give_up_between(kMin, sent_frames_.back() - half_frame_ns_);
}

/// False: it is for another message.
bool SampleQueue::add(const Entry& entry, Batch& batch) {
  const std::size_t count = batch.samples.size();
  if (count == 0) batch.first = entry.number;
  batch.message_bytes += static_cast<std::size_t>(message_bytes(entry.sample));
  if (count == wire::kMaxSamplesPerMessage || entry.number != batch.first + count) return false;
  if (count > 0 && batch.message_bytes > kMessagesTogether) return false;
  batch.samples.push_back(entry.sample);
  return true;
}

SampleQueue::Batch SampleQueue::unrecorded() const {
  const std::uint64_t end = policy_ == TopicPolicy::kAll ? end_ : sent_end_;
  auto entry = std::ranges::lower_bound(waiting_, recorded_end_, {}, &Entry::number);
  Batch batch;
  while (entry != waiting_.end() && entry->number < end && add(*entry, batch)) ++entry;
  return batch;
}

void SampleQueue::rewind(std::uint64_t next) {
  sent_ = 0;
  acknowledge(next);
}

void SampleQueue::acknowledge(std::uint64_t next) {
  while (!waiting_.empty() && waiting_.front().number < next) {
    bytes_ -= kBytesPerSample + message_bytes(waiting_.front().sample);
    waiting_.pop_front();
    if (sent_ > 0) --sent_;
  }
}

std::optional<SampleQueue::Batch> SampleQueue::take(std::int64_t upto_ns) {
  Batch batch;
  const bool is_by_time = policy_ != TopicPolicy::kFrames;
  for (; has_due(); ++sent_) {
    const Entry& entry = waiting_[sent_];
    if ((is_by_time && entry.sample.time_ns > upto_ns) || !add(entry, batch)) break;
    sent_end_ = std::max(sent_end_, entry.number + 1);
  }
  if (batch.samples.empty()) return std::nullopt;
  return batch;
}

bool SampleQueue::has_due() const {
  if (sent_ == waiting_.size()) return false;
  const Entry& entry = waiting_[sent_];
  return policy_ != TopicPolicy::kFrames || entry.number < sent_end_ || is_of_sent_frame(entry);
}

std::int64_t SampleQueue::unsent_ns() const {
  if (sent_ == waiting_.size()) return 0;
  return waiting_.back().sample.time_ns - waiting_[sent_].sample.time_ns;
}

}  // namespace orbbuf
