// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "daemon/buffer/features.hpp"

namespace orbbuf {

/// What makes a pair of features a match, beside being each other's nearest neighbours and at most
/// 64 bits apart. The defaults are M's; docs/design.md has the figures of others.
struct MatchRule {
  /// Lowe's ratio test, for both against their second nearest. 0: no such test.
  unsigned ratio_percent = 90;
  /// How many other matches, near it in both images, must have moved as it has.
  int supporters = 2;
};

/// How many features of `a` and `b` match by `rule`. Symmetric; a set that is empty, or has no more
/// features than a match must have supporters, is unlike everything. Pure, and integer arithmetic
/// throughout: the same features give the same count on every machine. Cost: one pass over all
/// |a| x |b| distances, in SIMD (nearest.hpp); allocates nothing but when sets grow.
int count_matches(const FeatureSet& a, const FeatureSet& b, const MatchRule& rule);

/// M(a, b) of the paper (Sec. III-B): how many ORB features are successfully matched. Strict, as it
/// must be to tell a lost scene from a kept one. M(a, a) is about the number of features (less
/// those that occur twice or stand alone).
int similarity(const FeatureSet& a, const FeatureSet& b);

/// How far the image moved from `a` to `b`: the median displacement of M's matches, as a share of
/// the image's width. Nothing if no feature matches. Cost: that of similarity().
std::optional<double> image_motion(const FeatureSet& a, const FeatureSet& b);

}  // namespace orbbuf
