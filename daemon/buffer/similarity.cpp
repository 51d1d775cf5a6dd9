// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/similarity.hpp"

#include <cstddef>
#include <cstdint>

#include "daemon/buffer/nearest.hpp"

namespace orbbuf {
namespace {

constexpr std::uint32_t kMaxDistance = 64;  // of 256 bits; unrelated descriptors lie around 128

// Lowe's ratio 0.8. Where there is no second, kNone stands for one that is far away.
bool is_distinct(const Nearest& nearest) {
  return nearest.distance() <= kMaxDistance &&
         5 * nearest.distance() < 4 * nearest.second_distance();
}

}  // namespace

int similarity(const FeatureSet& a, const FeatureSet& b) {
  thread_local Neighbours found;  // kept, so that a daemon in its stride allocates nothing
  find_nearest(a.descriptors, b.descriptors, found);
  int matches = 0;
  for (std::size_t i = 0; i < found.of_rows.size(); ++i) {
    const Nearest& there = found.of_rows[i];
    if (!is_distinct(there)) continue;  // also where there are no columns at all
    const Nearest& back = found.of_columns[there.index()];
    if (back.index() == i && is_distinct(back)) ++matches;
  }
  return matches;
}

}  // namespace orbbuf
