// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string_view>

#include "daemon/buffer/similarity.hpp"

namespace orbbuf::sim {

/// A way to count matches that M might have been; the last is M.
struct Rule {
  std::string_view name;
  MatchRule match;
};

inline constexpr std::array<Rule, 4> kRules = {{{"mutual, 64 bits", {0, 0}},
                                                {"and ratio 0.8", {80, 0}},
                                                {"and ratio 0.9", {90, 0}},
                                                {"and ratio 0.9, two supporters", {}}}};

}  // namespace orbbuf::sim
