// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/similarity.hpp"

#include <algorithm>
#include <cassert>
#include <cstddef>
#include <cstdint>

namespace orbbuf {
namespace {

constexpr std::uint32_t kMaxDistance = 64;  // of 256 bits; unrelated descriptors lie around 128

// Counts the bits of the four words in parallel: in pairs, nibbles, bytes, halves. The halves are
// for the sum, which may be 256. (On baseline x86-64 std::popcount is a call and a table.)
constexpr std::uint64_t kPairs = 0x5555555555555555;
constexpr std::uint64_t kNibbles = 0x3333333333333333;
constexpr std::uint64_t kBytes = 0x0f0f0f0f0f0f0f0f;
constexpr std::uint64_t kHalves = 0x00ff00ff00ff00ff;

std::uint32_t distance(const Descriptor& a, const Descriptor& b) {
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < a.size(); i += 2) {
    std::uint64_t x = a[i] ^ b[i];
    std::uint64_t y = a[i + 1] ^ b[i + 1];
    x -= (x >> 1) & kPairs;
    y -= (y >> 1) & kPairs;
    x = (x & kNibbles) + ((x >> 2) & kNibbles) + (y & kNibbles) + ((y >> 2) & kNibbles);
    sum += (x & kBytes) + ((x >> 4) & kBytes);
  }
  sum = (sum & kHalves) + ((sum >> 8) & kHalves);
  return static_cast<std::uint32_t>((sum * 0x0001000100010001) >> 48);
}

// The two nearest descriptors that one descriptor has seen. A candidate is its distance above its
// index, so that one comparison orders both and equal distances always have the same winner.
struct Nearest {
  static constexpr int kIndexBits = 23;  // 9 are left for a distance of 0 .. 256
  static constexpr std::uint32_t kNone = ~0U;

  std::uint32_t best = kNone;
  std::uint32_t second = kNone;

  void offer(std::uint32_t bits, std::size_t index) {
    const std::uint32_t candidate = (bits << kIndexBits) | static_cast<std::uint32_t>(index);
    second = std::min(second, std::max(best, candidate));
    best = std::min(best, candidate);
  }

  std::size_t index() const { return best & ((1U << kIndexBits) - 1); }

  // Lowe's ratio 0.8. Where there is no second, kNone stands for one that is far away.
  bool is_distinct() const {
    const std::uint32_t bits = best >> kIndexBits;
    return bits <= kMaxDistance && 5 * bits < 4 * (second >> kIndexBits);
  }
};

}  // namespace

int similarity(const FeatureSet& a, const FeatureSet& b) {
  const std::vector<Descriptor>& rows = a.descriptors;
  const std::vector<Descriptor>& columns = b.descriptors;
  assert(rows.size() >> Nearest::kIndexBits == 0 && columns.size() >> Nearest::kIndexBits == 0);
  std::vector<Nearest> of_row(rows.size());
  std::vector<Nearest> of_column(columns.size());
  std::vector<std::uint32_t> bits(columns.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    // A loop of its own, which compilers turn into vector code.
    for (std::size_t j = 0; j < columns.size(); ++j) bits[j] = distance(rows[i], columns[j]);
    Nearest nearest;
    for (std::size_t j = 0; j < columns.size(); ++j) {
      nearest.offer(bits[j], j);
      of_column[j].offer(bits[j], i);
    }
    of_row[i] = nearest;
  }
  int matches = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!of_row[i].is_distinct()) continue;  // also where there are no columns at all
    const Nearest& back = of_column[of_row[i].index()];
    if (back.index() == i && back.is_distinct()) ++matches;
  }
  return matches;
}

}  // namespace orbbuf
