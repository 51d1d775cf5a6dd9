// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/given_up.hpp"

#include <algorithm>

namespace orbbuf {

void GivenUp::add(std::span<const DropRecord> records) {
  for (const DropRecord& record : records) waiting_.add(record);
}

void GivenUp::rewind(std::uint64_t next) {
  sent_ = 0;
  for (; next < first_ && !kept_.empty(); --first_) {
    numbered_.push_front(kept_.back());
    kept_.pop_back();
  }
  acknowledge(next);
}

void GivenUp::acknowledge(std::uint64_t next) {
  for (; first_ < next && !numbered_.empty(); ++first_) {
    kept_.push_back(numbered_.front());
    numbered_.pop_front();
    if (sent_ > 0) --sent_;
    if (kept_.size() > kMostKept) kept_.pop_front();
  }
}

GivenUp::Items GivenUp::take_unsent(std::size_t most) {
  if (sent_ == numbered_.size()) {
    for (std::size_t i = 0; i < most && may_number(); ++i) {
      numbered_.push_back(waiting_.take_first());
    }
  }
  const auto begin = numbered_.begin() + static_cast<std::ptrdiff_t>(sent_);
  const std::size_t count = std::min(numbered_.size() - sent_, most);
  Items items{first_ + sent_, {begin, begin + static_cast<std::ptrdiff_t>(count)}};
  sent_ += count;
  return items;
}

Sequence GivenUp::settled_below(Sequence confirmed) const {
  if (!waiting_.is_empty()) confirmed = std::min(confirmed, waiting_.by_number().begin()->first);
  for (const DropRecord& record : numbered_) confirmed = std::min(confirmed, record.sequence);
  return confirmed;
}

}  // namespace orbbuf
