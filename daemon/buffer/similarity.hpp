// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "daemon/buffer/features.hpp"

namespace orbbuf {

/// The conditions for a match of two features, besides that each is the other's nearest neighbour
/// and that they differ in at most 64 bits. The defaults are M's; docs/design.md compares others.
struct MatchRule {
  /// Lowe's ratio test, for both against their second nearest. 0: no such test.
  unsigned ratio_percent = 90;
  /// How many other matches, near this one in both images, must have moved by the same amount.
  int supporters = 2;
};

/// How many features of `a` and `b` match by `rule`. Symmetric. 0 if a set has no more features
/// than `rule` asks for supporters. Uses integers only: the same features give the same count on
/// every machine. Reentrant. Cost: one pass over all |a| x |b| distances, in SIMD (nearest.hpp);
/// allocates only when the sets are larger than before.
int count_matches(const FeatureSet& a, const FeatureSet& b, const MatchRule& rule);

/// M(a, b) of the paper (Sec. III-B): the number of matched ORB features. The rule is strict, so
/// that M of two unrelated images is about 0. M(a, a) is about the number of features, without
/// those that occur twice or have no neighbours.
int similarity(const FeatureSet& a, const FeatureSet& b);

/// How far the image moved from `a` to `b`: the median displacement of M's matches, as a share of
/// the image's width. Empty if no feature matches. Cost: that of similarity().
std::optional<double> image_motion(const FeatureSet& a, const FeatureSet& b);

}  // namespace orbbuf
