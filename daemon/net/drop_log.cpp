// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/drop_log.hpp"

#include <algorithm>
#include <iterator>
#include <vector>

namespace orbbuf {

void DropLog::add(std::span<const DropRecord> records) { records_.push(records); }

void DropLog::rewind(std::uint64_t next_drop) {
  sent_ = 0;
  if (next_drop < first_) {
    const auto count = std::min<std::uint64_t>(first_ - next_drop, kept_.size());
    const auto begin = kept_.end() - static_cast<std::ptrdiff_t>(count);
    records_.put_back(std::vector<DropRecord>(begin, kept_.end()));
    kept_.erase(begin, kept_.end());
    first_ -= count;
  }
  acknowledge(next_drop);
}

void DropLog::acknowledge(std::uint64_t next_drop) {
  if (next_drop <= first_) return;
  const auto count = std::min(next_drop - first_, records_.size());
  const auto& oldest = records_.oldest();
  const auto here = static_cast<std::ptrdiff_t>(std::min<std::uint64_t>(count, oldest.size()));
  kept_.insert(kept_.end(), oldest.begin(), oldest.begin() + here);
  while (kept_.size() > kMostKept) kept_.pop_front();
  records_.pop(count);
  first_ += count;
  sent_ -= static_cast<std::size_t>(std::min<std::uint64_t>(sent_, count));
}

wire::Dropped DropLog::take_unsent() {
  const auto& records = records_.oldest();
  const std::size_t count = std::min(records.size() - sent_, wire::kMaxDropsPerMessage);
  const auto begin = std::next(records.begin(), static_cast<std::ptrdiff_t>(sent_));
  wire::Dropped message{first_ + sent_,
                        {begin, std::next(begin, static_cast<std::ptrdiff_t>(count))}};
  sent_ += count;
  return message;
}

}  // namespace orbbuf
