// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_queue.hpp"

#include <algorithm>

namespace orbbuf {

SampleQueue::SampleQueue(std::uint64_t bytes)
    : most_(static_cast<std::size_t>(std::max<std::uint64_t>(bytes / kBytesPerSample, 1))) {}

bool SampleQueue::push(const Sample& sample) {
  if (last_time_ns_ && sample.time_ns <= *last_time_ns_) return false;
  if (waiting_.size() == most_) make_room();
  last_time_ns_ = sample.time_ns;
  waiting_.push_back({end_++, sample});
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
  waiting_.erase(victim);
  if (number >= recorded_end_) {
    ++lost_;
    return;
  }
  ++late_;
  if (new_late_.empty() || new_late_.back().end != number) new_late_.push_back({number, number});
  ++new_late_.back().end;
}

SampleQueue::Batch SampleQueue::unrecorded() const {
  auto entry = std::ranges::lower_bound(waiting_, recorded_end_, {}, &Entry::number);
  Batch batch;
  if (entry != waiting_.end()) batch.first = entry->number;
  for (; entry != waiting_.end() && batch.samples.size() < wire::kMaxSamplesPerMessage; ++entry) {
    if (entry->number != batch.first + batch.samples.size()) break;
    batch.samples.push_back(entry->sample);
  }
  return batch;
}

void SampleQueue::rewind(std::uint64_t next) {
  sent_ = 0;
  acknowledge(next);
}

void SampleQueue::acknowledge(std::uint64_t next) {
  while (!waiting_.empty() && waiting_.front().number < next) {
    waiting_.pop_front();
    if (sent_ > 0) --sent_;
  }
}

std::optional<SampleQueue::Batch> SampleQueue::take(std::int64_t upto_ns) {
  Batch batch;
  for (; sent_ < waiting_.size() && batch.samples.size() < wire::kMaxSamplesPerMessage; ++sent_) {
    const auto& [number, sample] = waiting_[sent_];
    if (sample.time_ns > upto_ns) break;
    if (batch.samples.empty()) batch.first = number;
    if (number != batch.first + batch.samples.size()) break;
    batch.samples.push_back(sample);
    sent_end_ = std::max(sent_end_, number + 1);
  }
  if (batch.samples.empty()) return std::nullopt;
  return batch;
}

std::int64_t SampleQueue::unsent_ns() const {
  if (sent_ == waiting_.size()) return 0;
  return waiting_.back().sample.time_ns - waiting_[sent_].sample.time_ns;
}

}  // namespace orbbuf
