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
  if (!view.previous) return 0;  // free to go, whatever the others are worth
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

// Newest first, those that are missing, as far as the budget goes. A frame's features may be
// extracted although the budget then ends before the score: the next call finds them.
void OrbPolicy::compute_scores(const BufferView& view, Budget& budget) {
  for (std::size_t right = view.waiting.size(); right-- > 1 && budget.comparisons > 0;) {
    const std::size_t i = right - 1;
    if (known_score(view, i)) continue;
    const FramePtr& left_frame = view.left_of(i);
    const FramePtr& right_frame = view.waiting[right];
    const FeatureSet* right_features = features(right_frame, budget);
    const FeatureSet* left_features = features(left_frame, budget);
    if (!left_features || !right_features) continue;
    --budget.comparisons;
    slot(view.waiting[i]).score = {left_frame->sequence, right_frame->sequence,
                                   m_(*left_features, *right_features)};
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

// Null if they are missing and the budget has no extraction left.
const FeatureSet* OrbPolicy::features(const FramePtr& frame, Budget& budget) {
  Slot& slot = this->slot(frame);
  if (!slot.has_features) {
    if (budget.extractions == 0) return nullptr;
    --budget.extractions;
    extract_(*frame, slot.features);
    slot.has_features = true;
  }
  return &slot.features;
}

const OrbPolicy::Slot* OrbPolicy::find(const FramePtr& frame) const {
  const auto slot = std::ranges::find(slots_, frame->sequence, &Slot::sequence);
  return slot == slots_.end() ? nullptr : &*slot;
}

OrbPolicy::Slot& OrbPolicy::slot(const FramePtr& frame) {
  auto slot = std::ranges::find(slots_, frame->sequence, &Slot::sequence);
  if (slot != slots_.end()) return *slot;
  slot = std::ranges::find_if(slots_, [](const Slot& s) { return s.frame.expired(); });
  if (slot == slots_.end()) slot = slots_.emplace(slots_.end());
  slot->sequence = frame->sequence;
  slot->frame = frame;
  slot->has_features = false;
  slot->score.reset();
  return *slot;
}

}  // namespace orbbuf
