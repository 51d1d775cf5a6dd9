// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "bench/sim/simulation.hpp"

namespace orbbuf::sim {

/// How alike frames i and j are.
using PairSimilarity = std::function<int(std::size_t i, std::size_t j)>;

/// What any policy could have delivered, k by k, with the opportunities that `delivery` had: the
/// same takes at the same moments and a drop whenever it had one. received[k] may be any frame from
/// first[k] to last[k], as long as the sequence increases; every such sequence is the work of some
/// policy, and no policy's is missing. The proof is in docs/design.md.
struct Choices {
  std::vector<std::size_t> first;
  std::vector<std::size_t> last;
};

Choices choices(const Delivery& delivery);

/// The best of them, by dynamic programming: the largest smallest similarity between neighbours,
/// with the future known, so an upper bound for any policy. Of prefixes equal in that, the one with
/// the largest product goes on.
std::vector<std::size_t> fifo_oracle(const Delivery& delivery, const PairSimilarity& similarity);

}  // namespace orbbuf::sim
