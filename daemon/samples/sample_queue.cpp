// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_queue.hpp"

#include <algorithm>

namespace orbbuf {

namespace {

/// More messages of topics than these do not go together over the link.
constexpr std::size_t kMessagesTogether = std::size_t{64} << 10U;

std::uint64_t message_bytes(const Sample& sample) {
  return sample.message ? sizeof(TopicMessage) + sample.message->cdr.size() : 0;
}

}  // namespace

SampleQueue::SampleQueue(std::uint64_t bytes, bool is_latest_only)
    : most_bytes_(bytes), is_latest_only_(is_latest_only) {}

bool SampleQueue::push(const Sample& sample) {
  const bool is_message = sample.message != nullptr;
  if (!is_message && last_time_ns_ && sample.time_ns <= *last_time_ns_) return false;
  if (is_message && sample.message->cdr.size() > wire::kMaxTopicMessageBytes) {
    ++end_;
    ++lost_;
    return false;
  }
  const std::uint64_t bytes = kBytesPerSample + message_bytes(sample);
  const auto has_to_go = [&] {
    return bytes_ + bytes > most_bytes_ || (is_latest_only_ && waiting_.back().number >= sent_end_);
  };
  while (!waiting_.empty() && has_to_go()) make_room();
  last_time_ns_ = sample.time_ns;
  waiting_.push_back({end_++, sample});
  bytes_ += bytes;
  return true;
}

/// Those that were sent are few, and the server may have them.
void SampleQueue::make_room() {
  auto victim = std::ranges::lower_bound(waiting_, sent_end_, {}, &Entry::number);
  if (victim == waiting_.end()) {
    victim = waiting_.begin();
    if (sent_ > 0) --sent_;
  }
  const std::uint64_t number = victim->number;
  bytes_ -= kBytesPerSample + message_bytes(victim->sample);
  waiting_.erase(victim);
  if (number >= recorded_end_) {
    ++lost_;
    return;
  }
  ++late_;
  if (new_late_.empty() || new_late_.back().end != number) new_late_.push_back({number, number});
  ++new_late_.back().end;
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
  auto entry = std::ranges::lower_bound(waiting_, recorded_end_, {}, &Entry::number);
  Batch batch;
  while (entry != waiting_.end() && add(*entry, batch)) ++entry;
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
  for (; sent_ < waiting_.size(); ++sent_) {
    const Entry& entry = waiting_[sent_];
    if (entry.sample.time_ns > upto_ns || !add(entry, batch)) break;
    sent_end_ = std::max(sent_end_, entry.number + 1);
  }
  if (batch.samples.empty()) return std::nullopt;
  return batch;
}

std::int64_t SampleQueue::unsent_ns() const {
  if (sent_ == waiting_.size()) return 0;
  return waiting_.back().sample.time_ns - waiting_[sent_].sample.time_ns;
}

}  // namespace orbbuf
