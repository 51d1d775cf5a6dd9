// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <boost/container/static_vector.hpp>
#include <optional>
#include <utility>

#include "common/frame.hpp"
#include "daemon/buffer/send_planner.hpp"

namespace orbbuf {

/// The frames that the link will probably take next, and that are to be made smaller before that:
/// what is wanted, and what has been made of it. Reentrant; FrameBuffer's mutex guards it.
class Reductions {
 public:
  /// To make `whole` at a lower quality.
  struct Job {
    FramePtr whole;
    int quality = 0;
  };
  using Jobs = boost::container::static_vector<Job, SendPlanner::Choices::static_capacity>;

  /// These are wanted, the most urgent one first, and nothing else. What has been made of a frame
  /// stays; it is made again if `is_close` finds the quality too far from what is wanted now.
  template <class IsClose>
  void want(const Jobs& jobs, const IsClose& is_close) {
    Items items;
    for (const Job& job : jobs) {
      const Item* const known = find(job.whole);
      const bool is_good =
          known && (known->state == State::kFailed || is_close(known->job.quality, job.quality));
      items.push_back(is_good ? *known
                              : Item{job, State::kWanted, known ? known->reduced : nullptr});
    }
    items_ = std::move(items);
  }

  /// Whether next() has something.
  bool is_wanting() const {
    return std::ranges::find(items_, State::kWanted, &Item::state) != items_.end();
  }

  /// The most urgent job that is not begun, which is begun now.
  std::optional<Job> next() {
    const auto item = std::ranges::find(items_, State::kWanted, &Item::state);
    if (item == items_.end()) return std::nullopt;
    item->state = State::kBegun;
    return item->job;
  }

  /// What came of a job; null: the frame cannot be made smaller.
  void on_made(const Job& job, FramePtr reduced) {
    for (Item& item : items_) {
      if (item.job.whole != job.whole) continue;
      // Another quality may be wanted by now: then this one serves until that is made.
      if (item.job.quality == job.quality) item.state = reduced ? State::kMade : State::kFailed;
      if (reduced) item.reduced = std::move(reduced);
      return;
    }
  }

  /// The frame as it was made smaller last; null if it was not.
  FramePtr reduced(const FramePtr& whole) const {
    const Item* const item = find(whole);
    return item ? item->reduced : nullptr;
  }

  /// Whether that was tried and cannot be done.
  bool has_failed(const FramePtr& whole) const {
    const Item* const item = find(whole);
    return item && item->state == State::kFailed;
  }

 private:
  enum class State { kWanted, kBegun, kMade, kFailed };
  struct Item {
    Job job;
    State state = State::kWanted;
    FramePtr reduced;  ///< perhaps at another quality than the job's
  };
  using Items = boost::container::static_vector<Item, Jobs::static_capacity>;

  const Item* find(const FramePtr& whole) const {
    const auto item = std::ranges::find(items_, whole, [](const Item& i) { return i.job.whole; });
    return item == items_.end() ? nullptr : &*item;
  }

  Items items_;
};

}  // namespace orbbuf
