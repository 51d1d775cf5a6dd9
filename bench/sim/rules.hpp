// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string_view>

#include "daemon/buffer/features.hpp"

namespace orbbuf::sim {

/// A way to count matches that M might have been; the last is M. See similarity.hpp.
struct Rule {
  std::string_view name;
  unsigned ratio_percent;  ///< of Lowe's test; 0: no such test
  int supporters;
};

inline constexpr std::array<Rule, 4> kRules = {{{"mutual, 64 bits", 0, 0},
                                                {"and ratio 0.8", 80, 0},
                                                {"and ratio 0.9", 90, 0},
                                                {"and ratio 0.9, two supporters", 90, 2}}};

int matches(const Rule& rule, const FeatureSet& a, const FeatureSet& b);

}  // namespace orbbuf::sim
