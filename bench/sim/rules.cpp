// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/rules.hpp"

#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "daemon/buffer/nearest.hpp"

namespace orbbuf::sim {
namespace {

constexpr std::uint32_t kMaxDistance = 64;
constexpr int kNear = 184;
constexpr int kAlike = 30;

struct Moved {
  Position from;
  Position to;
};

bool passes(const Rule& rule, const Nearest& nearest) {
  return nearest.distance() <= kMaxDistance &&
         (rule.ratio_percent == 0 ||
          100 * nearest.distance() < rule.ratio_percent * nearest.second_distance());
}

bool supports(const Moved& one, const Moved& other) {
  const Position from{static_cast<std::int16_t>(other.from.x - one.from.x),
                      static_cast<std::int16_t>(other.from.y - one.from.y)};
  const Position to{static_cast<std::int16_t>(other.to.x - one.to.x),
                    static_cast<std::int16_t>(other.to.y - one.to.y)};
  return std::abs(from.x) + std::abs(from.y) <= kNear && std::abs(to.x) + std::abs(to.y) <= kNear &&
         std::abs(to.x - from.x) <= kAlike && std::abs(to.y - from.y) <= kAlike;
}

}  // namespace

int matches(const Rule& rule, const FeatureSet& a, const FeatureSet& b) {
  Neighbours found;
  find_nearest(a.descriptors, b.descriptors, found);
  std::vector<Moved> all;
  for (std::size_t i = 0; i < found.of_rows.size(); ++i) {
    const Nearest& there = found.of_rows[i];
    if (!passes(rule, there)) continue;
    const Nearest& back = found.of_columns[there.index()];
    if (back.index() == i && passes(rule, back)) {
      all.push_back({a.positions[i], b.positions[there.index()]});
    }
  }
  const auto is_supported = [&](const Moved& match) {
    return std::ranges::count_if(all, [&](const Moved& other) { return supports(match, other); }) >
           rule.supporters;  // it counts itself
  };
  return static_cast<int>(std::ranges::count_if(all, is_supported));
}

}  // namespace orbbuf::sim
