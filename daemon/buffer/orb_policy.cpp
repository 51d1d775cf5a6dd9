// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/orb_policy.hpp"

#include <algorithm>
#include <cassert>
#include <utility>

namespace orbbuf {

OrbPolicy::OrbPolicy(FillFeatures extract, Similarity m)
    : extract_(std::move(extract)), m_(std::move(m)) {
  assert(extract_ && m_);
}

bool OrbPolicy::prepare(const BufferView& view) {
  constexpr int kComparisons = 3;
  Budget without_extraction{0, kComparisons};
  compute_scores(view, without_extraction);
  if (without_extraction.comparisons == kComparisons) {
    Budget with_extraction{1, kComparisons};
    compute_scores(view, with_extraction);
  }
  for (std::size_t i = 0; i + 1 < view.waiting.size(); ++i) {
    if (!known_score(view, i)) return true;
  }
  return false;
}

std::size_t OrbPolicy::victim(const BufferView& view) {
  last_score_.reset();
  if (!view.previous) return 0;  // the head has no left neighbour
  const Sequence newest = view.waiting.back()->sequence;
  if (std::exchange(arrival_, newest) != newest) {
    budget_ = {kExtractionsPerArrival, kComparisonsPerArrival};
  }
  compute_scores(view, budget_);
  // No score is less than any other, and equal to none.
  std::size_t best = 0;
  std::optional<int> best_score = known_score(view, 0);
  for (std::size_t i = 1; i + 1 < view.waiting.size(); ++i) {
    const std::optional<int> score = known_score(view, i);
    if (score > best_score ||
        (score == best_score && view.gap_without(i) < view.gap_without(best))) {
      best = i;
      best_score = score;
    }
  }
  last_score_ = best_score;
  return best;
}

std::vector<int> OrbPolicy::scores(const BufferView& view) {
  Budget unlimited{std::numeric_limits<int>::max(), std::numeric_limits<int>::max()};
  compute_scores(view, unlimited);
  std::vector<int> scores;
  for (std::size_t i = 0; i + 1 < view.waiting.size(); ++i) {
    scores.push_back(known_score(view, i).value());
  }
  return scores;
}

// The missing scores, newest first, within the budget. If the budget ends between a frame's
// features and its score, the next call uses the features.
void OrbPolicy::compute_scores(const BufferView& view, Budget& budget) {
  for (std::size_t right = view.waiting.size(); right-- > 1 && budget.comparisons > 0;) {
    const std::size_t i = right - 1;
    if (known_score(view, i)) continue;
    const FramePtr& left_frame = view.left_of(i);
    const FramePtr& right_frame = view.waiting[right];
    const bool has_right = ensure_features(right_frame, budget);
    const bool has_left = ensure_features(left_frame, budget);
    if (!has_left || !has_right) continue;
    --budget.comparisons;
    Slot& middle = slot(view.waiting[i]);  // may move the others
    middle.score = {left_frame->sequence, right_frame->sequence,
                    m_(slot(left_frame).features, slot(right_frame).features)};
  }
}

std::optional<int> OrbPolicy::known_score(const BufferView& view, std::size_t i) const {
  const FramePtr& left = view.left_of(i);
  if (!left) return kFreeToGo;
  const Slot* slot = find(view.waiting[i]);
  if (!slot || !slot->score || slot->score->left != left->sequence ||
      slot->score->right != view.waiting[i + 1]->sequence) {
    return std::nullopt;
  }
  return slot->score->value;
}

// Extracts them if they are missing and the budget allows it.
bool OrbPolicy::ensure_features(const FramePtr& frame, Budget& budget) {
  Slot& slot = this->slot(frame);
  if (!slot.has_features) {
    if (budget.extractions == 0) return false;
    --budget.extractions;
    extract_(*frame, slot.features);
    slot.has_features = true;
  }
  return true;
}

const OrbPolicy::Slot* OrbPolicy::find(const FramePtr& frame) const {
  const auto slot = std::ranges::lower_bound(slots_, frame->sequence, {}, &Slot::sequence);
  return slot == slots_.end() || slot->sequence != frame->sequence ? nullptr : &*slot;
}

OrbPolicy::Slot& OrbPolicy::slot(const FramePtr& frame) {
  auto slot = std::ranges::lower_bound(slots_, frame->sequence, {}, &Slot::sequence);
  if (slot != slots_.end() && slot->sequence == frame->sequence) return *slot;
  const auto gone = std::ranges::find_if(slots_, [](const Slot& s) { return s.frame.expired(); });
  if (gone == slots_.end()) {
    slot = slots_.emplace(slot);
  } else if (gone < slot) {
    slot = std::rotate(gone, gone + 1, slot);
  } else {
    std::rotate(slot, gone, gone + 1);
  }
  slot->sequence = frame->sequence;
  slot->frame = frame;
  slot->has_features = false;
  slot->score.reset();
  return *slot;
}

}  // namespace orbbuf
