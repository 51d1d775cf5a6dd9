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

/// The paper's policy (Sec. III-D): gives up the frame whose two neighbours are most alike. Of all
/// single drops this keeps the smallest similarity between received neighbours the largest.
///
/// The score of a frame is M of its two neighbours. The left neighbour of the head is the frame
/// last handed to the network. So taking the head changes no score, and an arrival changes at most
/// three: that of the frame which now has a right neighbour, and those of the two neighbours of the
/// last victim.
///
/// Cost of an arrival: at most three M(), and the features of the new frame; nothing while the link
/// keeps up, since no frame is dropped then. A frame's features are kept as long as the frame, so
/// they are extracted at most once. Their memory is used for later frames and never released: 32
/// bytes a feature, 16 KB for a frame of 500, times the largest number of frames alive at once.
///
/// When frames begin to wait, and when a broken connection returns the frames in flight, many
/// scores are missing at once. prepare() computes them in idle time. Until then victim() chooses
/// among the frames whose scores are known.
class OrbPolicy final : public DropPolicy {
 public:
  /// The score of a head without a left neighbour: it is given up first.
  static constexpr int kFreeToGo = std::numeric_limits<int>::max();
  /// What the victims of one arrival may cost together: as many M() as an arrival can change, its
  /// own extraction, and one more for a frame whose features are missing.
  static constexpr int kExtractionsPerArrival = 2;
  static constexpr int kComparisonsPerArrival = 3;

  explicit OrbPolicy(FillFeatures extract, Similarity m = similarity);

  /// A unit is at most three M() of features that are extracted; or else one extraction, and the
  /// at most two M() that it makes possible. The newest frames come first, in victim() too: the
  /// next arrivals need their features.
  bool prepare(const BufferView& view) override;

  /// The frame of the largest score. Of equals the one whose neighbours are closest in time, then
  /// the older. Exact if no more is missing than the budget of an arrival. Otherwise chooses among
  /// the frames whose scores are known, and if there are none, as UniformPolicy does. An arrival is
  /// a newest frame that victim() has not seen before.
  std::size_t victim(const BufferView& view) override;

  std::optional<int> last_score() const override { return last_score_; }

  /// The score of each waiting frame but the newest, which has none yet. Computes all missing ones;
  /// for tests.
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
  /// What is known of a frame. The slot of a frame that is gone is used again.
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
