// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "bench/sim/epipolar.hpp"
#include "common/frame.hpp"
#include "daemon/buffer/features.hpp"
#include "daemon/capture/make_source.hpp"

namespace orbbuf::sim {

/// A whole sequence in memory, as orbbufd would have encoded it, and how alike any two of its
/// frames are. Both measures are computed when first asked for and kept.
class RecordedSequence {
 public:
  static constexpr int kLeastQuality = 10;

  /// Reads the source to its end; JPEG and features as orbbufd's defaults have them. Throws
  /// std::runtime_error if the source cannot be opened.
  RecordedSequence(std::string name, SourceSettings source);

  const std::string& name() const { return name_; }
  std::size_t size() const { return frames_.size(); }
  /// frames()[i]->sequence is i; capture times begin at 0.
  const std::vector<FramePtr>& frames() const { return frames_; }
  const FramePtr& frame(std::size_t i) const { return frames_[i]; }
  const FeatureSet& features(std::size_t i) const { return features_[i]; }

  /// The size of frame i as Requantiser makes it at `quality`, between its own and kLeastQuality.
  /// Made at some qualities; interpolated between them.
  std::size_t bytes_at(std::size_t i, int quality) const;

  double mean_interval_ns() const;
  double mean_jpeg_bytes() const;
  /// The mean of M(a, a).
  double self_similarity() const;

  /// M of frames i and j.
  int similarity(std::size_t i, std::size_t j);
  /// The yardstick that is not M, see epipolar.hpp.
  int epipolar_inliers(std::size_t i, std::size_t j);

 private:
  using Pair = std::pair<std::size_t, std::size_t>;

  const EpipolarView& view(std::size_t i);

  std::string name_;
  std::vector<FramePtr> frames_;
  std::vector<FeatureSet> features_;
  std::vector<std::vector<double>> sizes_;  // of each frame, at kQualities
  std::map<std::size_t, EpipolarView> views_;
  std::vector<int> similarities_;  // row by row; -1: not yet computed
  std::map<Pair, int> inliers_;
};

}  // namespace orbbuf::sim
