// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "bench/sim/recorded_sequence.hpp"
#include "bench/sim/rules.hpp"

namespace orbbuf::sim {

using Sequences = std::vector<std::unique_ptr<RecordedSequence>>;

/// What is left of M as frames lie further apart, as shares of M(a, a) (paper, Sec. III-F,
/// fig. "correlation").
struct DistancePoint {
  std::size_t distance = 0;  ///< frames
  double low = 0;            ///< 5 % of the pairs are below
  double middle = 0;
  double high = 0;      ///< 5 % are above
  double epipolar = 0;  ///< mean number of epipolar inliers
};

/// For distances 1 to 45, or as far as there are pairs.
std::vector<DistancePoint> distance_curve(RecordedSequence& sequence);

/// What `rule` counts for `count` pairs of frames drawn from different sequences, as shares of the
/// features of the poorer frame; in rising order. What it says of frames that share nothing.
std::vector<double> noise_floor(const Rule& rule, const Sequences& sequences, std::size_t count,
                                std::uint64_t seed);

/// What `rule` counts between neighbours, as shares of the features; in rising order.
std::vector<double> neighbours(const Rule& rule, const RecordedSequence& sequence);

/// Spearman's rank correlation of what `rule` counts with the epipolar inliers, over all pairs up
/// to 45 frames apart: how well the rule predicts what the yardstick says.
double rank_correlation(const Rule& rule, RecordedSequence& sequence);

}  // namespace orbbuf::sim
