// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/orb_policy.hpp"

#include <cassert>
#include <utility>

namespace orbbuf {

OrbPolicy::OrbPolicy(ExtractFeatures extract, Similarity m)
    : extract_(std::move(extract)), m_(std::move(m)) {
  assert(extract_ && m_);
}

void OrbPolicy::observe(const BufferView& view) { scores(view); }

std::size_t OrbPolicy::victim(const BufferView& view) {
  const std::vector<int> scores = this->scores(view);
  std::size_t best = 0;
  for (std::size_t i = 1; i < scores.size(); ++i) {
    if (scores[i] > scores[best] ||
        (scores[i] == scores[best] && view.gap_without(i) < view.gap_without(best))) {
      best = i;
    }
  }
  return best;
}

std::vector<int> OrbPolicy::scores(const BufferView& view) {
  std::erase_if(known_, [](const auto& item) { return item.second.frame.expired(); });
  std::vector<int> scores;
  for (std::size_t i = 0; i + 1 < view.waiting.size(); ++i) {
    scores.push_back(score(view.left_of(i), view.waiting[i], view.waiting[i + 1]));
  }
  return scores;
}

int OrbPolicy::score(const FramePtr& left, const FramePtr& frame, const FramePtr& right) {
  if (!left) return kFreeToGo;
  std::optional<Score>& score = known(frame).score;
  if (!score || score->left != left->sequence || score->right != right->sequence) {
    score = {left->sequence, right->sequence, m_(features(left), features(right))};
  }
  return score->value;
}

const FeatureSet& OrbPolicy::features(const FramePtr& frame) {
  std::optional<FeatureSet>& features = known(frame).features;
  if (!features) features = extract_(*frame);
  return *features;
}

// References into the map stay valid while other frames become known.
OrbPolicy::Known& OrbPolicy::known(const FramePtr& frame) {
  return known_.try_emplace(frame->sequence, Known{frame, {}, {}}).first->second;
}

}  // namespace orbbuf
