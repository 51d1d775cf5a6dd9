// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "daemon/buffer/features.hpp"

namespace orbbuf {

/// M(a, b) of the paper (Sec. III-B): how many ORB features match between two frames.
///
/// Strict, as it must be to tell a lost scene from a kept one (docs/design.md): a pair counts if
/// each is the other's nearest neighbour, both pass Lowe's ratio test at 0.8 against their second
/// nearest, and they are at most 64 bits apart. So M(a, b) = M(b, a), M(a, a) is the number of
/// features (less any that occur twice), and an empty set is unlike everything. Pure and
/// deterministic. Cost: one pass over all |a| x |b| distances; each thread that calls it keeps the
/// memory it needed (some 30 KB for 500 features).
int similarity(const FeatureSet& a, const FeatureSet& b);

}  // namespace orbbuf
