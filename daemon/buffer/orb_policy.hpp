// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
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
/// Cost of an arrival: three M() at most, and the features of the new frame; nothing at all while
/// the link keeps up, since there is nothing to drop. Features are kept as long as the frame itself
/// is, so they are extracted at most once; their memory is then used for another frame and never
/// given back: 32 bytes each, 16 KB for a frame of 500, times the most frames alive at once.
///
/// When waiting begins, and when a broken connection returns what was in flight, far more is
/// missing at once. prepare() makes up for that in idle time. A victim that is wanted sooner is
/// chosen among the frames whose scores are known by then: see victim().
class OrbPolicy final : public DropPolicy {
 public:
  /// Of a head with nothing before it: to give it up tears nothing apart, so it goes first.
  static constexpr int kFreeToGo = std::numeric_limits<int>::max();
  /// What the victims of one arrival may cost together: as many M() as an arrival can change, and
  /// one extraction besides its own, to catch up.
  static constexpr int kExtractionsPerArrival = 2;
  static constexpr int kComparisonsPerArrival = 3;

  explicit OrbPolicy(FillFeatures extract, Similarity m = similarity);

  /// A unit is at most three M() of features that are there; or else one extraction, and the M()
  /// that it makes possible, of which there are at most two. The newest come first, in victim()
  /// too: they are what the next arrivals need.
  bool prepare(const BufferView& view) override;

  /// The frame of the largest score. Of equals the one whose neighbours are closest in time, then
  /// the older. Exact if no more is missing than the above allows; otherwise only the frames whose
  /// scores are known by then compete, and if there are none, all do, by the time between their
  /// neighbours, as with UniformPolicy. An arrival is a newest frame not seen by victim() before.
  std::size_t victim(const BufferView& view) override;

  std::optional<int> last_score() const override { return last_score_; }

  /// The score of each waiting frame but the newest, which has none yet. Computes whatever is
  /// missing; for tests.
  std::vector<int> scores(const BufferView& view);

 private:
  struct Budget {
    int extractions = 0;
    int comparisons = 0;
  };
  struct Score {
    Sequence left = 0;
    Sequence right = 0;
    int value = 0;
  };
  /// What is known of a frame. Of one that is gone, a slot to use again.
  struct Slot {
    Sequence sequence = 0;
    std::weak_ptr<const EncodedFrame> frame;  // in the buffer, or in flight: it may come back
    bool has_features = false;
    FeatureSet features;
    std::optional<Score> score;
  };

  void compute_scores(const BufferView& view, Budget& budget);
  std::optional<int> known_score(const BufferView& view, std::size_t i) const;
  bool ensure_features(const FramePtr& frame, Budget& budget);
  const Slot* find(const FramePtr& frame) const;
  Slot& slot(const FramePtr& frame);

  const FillFeatures extract_;
  const Similarity m_;
  std::vector<Slot> slots_;  // by sequence; as many as frames were ever alive at once
  std::optional<Sequence> arrival_;
  Budget budget_;  // what is left of arrival_'s
  std::optional<int> last_score_;
};

}  // namespace orbbuf
