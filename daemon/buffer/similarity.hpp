// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "daemon/buffer/features.hpp"

namespace orbbuf {

/// M(a, b) of the paper (Sec. III-B): how many ORB features are successfully
/// matched.
///
/// Strict, as it must be to tell a lost scene from a kept one (docs/design.md
/// has the figures). A pair of features matches if each is the other's nearest
/// neighbour, both pass Lowe's ratio test at 0.9 against their second nearest,
/// they are at most 64 bits apart, and the pair has two supporters: other
/// matches near it in both images that have moved as it has.
///
/// So M(a, b) = M(b, a); M(a, a) is about the number of features (less those
/// that occur twice or stand alone); a set of less than three features is
/// unlike everything. Pure, and integer arithmetic throughout: the same
/// features give the same M on every machine. Cost: one pass over all |a| x |b|
/// distances, in SIMD (nearest.hpp); allocates nothing but when sets grow.
int similarity(const FeatureSet& a, const FeatureSet& b);

}  // namespace orbbuf
