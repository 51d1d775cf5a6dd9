// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <string_view>

#include "bench/sim/fifo_oracle.hpp"
#include "daemon/buffer/drop_policy.hpp"

namespace orbbuf::sim {

/// What was tried beside the paper's method and has not replaced it (docs/design.md has the
/// figures); for the simulator only, and as dear as it happens to be.
///   eq3      the paper's eq. 3 to the letter: the drop after which the smallest similarity between
///            neighbours is largest. A fourth M() an arrival.
///   product  eq. 2: the drop that costs the product of all similarities least.
///   barrier  protects the pair that would break first: least growth of the sum of M^-4.
///   rate     similarity for the time it has to last: the largest score over the gap it leaves.
///   plan     which fifth of the frames would be given up next if the outage went on? The most
///            redundant of those, by dynamic programming over all pairs that wait.
inline constexpr std::array<std::string_view, 5> kIdeas = {"eq3", "product", "barrier", "rate",
                                                           "plan"};

/// `name`: one of kIdeas. `similarity` judges frames by their sequence numbers.
std::unique_ptr<DropPolicy> make_idea(std::string_view name, PairSimilarity similarity);

}  // namespace orbbuf::sim
