// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <unordered_map>
#include <vector>

#include "daemon/buffer/drop_policy.hpp"
#include "daemon/buffer/features.hpp"
#include "daemon/buffer/similarity.hpp"

namespace orbbuf {

/// M(a, b): any symmetric measure; larger is more alike.
using Similarity = std::function<int(const FeatureSet&, const FeatureSet&)>;

/// The paper's policy (Sec. III-D): gives up the frame whose two neighbours are most alike, which
/// keeps the smallest similarity between neighbours in what is received as large as one drop can.
///
/// The score of a frame is M of its neighbours: what they will be to each other once it is gone.
/// The left neighbour of the head is the frame last handed to the network. So taking the head
/// changes no score, and an arrival at most three: that of the frame which now has a right
/// neighbour, and those of the two which lost theirs to the last drop.
///
/// Cost of an arrival: three M() at most, and the features of the new frame. Nothing at all while
/// the link keeps up, since nobody asks then. Features are kept as long as the frame itself is, so
/// they are extracted at most once.
class OrbPolicy final : public DropPolicy {
 public:
  /// Of a head with nothing before it: to give it up tears nothing apart, so it goes first.
  static constexpr int kFreeToGo = std::numeric_limits<int>::max();

  explicit OrbPolicy(ExtractFeatures extract, Similarity m = similarity);

  /// Brings the scores up to date, so that victim() has less to do when a frame must go.
  void observe(const BufferView& view) override;

  /// The frame of the largest score. Of equals the one whose neighbours are closest in time, then
  /// the older.
  std::size_t victim(const BufferView& view) override;

  /// The score of each waiting frame but the newest, which has none yet.
  std::vector<int> scores(const BufferView& view);

 private:
  struct Score {
    Sequence left = 0;
    Sequence right = 0;
    int value = 0;
  };
  struct Known {
    std::weak_ptr<const EncodedFrame> frame;
    std::optional<FeatureSet> features;
    std::optional<Score> score;
  };

  int score(const FramePtr& left, const FramePtr& frame, const FramePtr& right);
  const FeatureSet& features(const FramePtr& frame);
  Known& known(const FramePtr& frame);

  const ExtractFeatures extract_;
  const Similarity m_;
  std::unordered_map<Sequence, Known> known_;  // frames that are gone are removed at the next call
};

}  // namespace orbbuf
