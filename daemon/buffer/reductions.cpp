// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/reductions.hpp"

#include <algorithm>
#include <utility>

namespace orbbuf {

bool Reductions::is_wanting() const {
  return std::ranges::find(items_, State::kWanted, &Item::state) != items_.end();
}

std::optional<Reductions::Job> Reductions::next() {
  const auto item = std::ranges::find(items_, State::kWanted, &Item::state);
  if (item == items_.end()) return std::nullopt;
  item->state = State::kBegun;
  return item->job;
}

void Reductions::on_made(const Job& job, FramePtr reduced) {
  for (Item& item : items_) {
    if (item.job.whole != job.whole) continue;
    // Another quality may be wanted by now: then this one serves until that is made.
    if (item.job.quality == job.quality) item.state = reduced ? State::kMade : State::kFailed;
    if (reduced) item.reduced = std::move(reduced);
    return;
  }
}

FramePtr Reductions::reduced(const FramePtr& whole) const {
  const Item* const item = find(whole);
  return item ? item->reduced : nullptr;
}

bool Reductions::has_failed(const FramePtr& whole) const {
  const Item* const item = find(whole);
  return item && item->state == State::kFailed;
}

const Reductions::Item* Reductions::find(const FramePtr& whole) const {
  const auto item = std::ranges::find(items_, whole, [](const Item& i) { return i.job.whole; });
  return item == items_.end() ? nullptr : &*item;
}

}  // namespace orbbuf
