// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/similarity.hpp"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "daemon/buffer/nearest.hpp"

namespace orbbuf {
namespace {

constexpr std::uint32_t kMaxDistance = 64;  // of 256 bits; unrelated descriptors lie around 128

// In units of ImagePoint, 1024 to the width of the image.
constexpr int kNear = 184;  // two matches this far apart, dx + dy, can support each other
constexpr int kAlike = 30;  // if their movements differ by at most this, along each axis

struct Match {
  ImagePoint in_a;
  ImagePoint in_b;
};

// Without a second candidate, kNone counts as one that is far away.
bool is_distinct(const Nearest& nearest, const MatchRule& rule) {
  return nearest.distance() <= kMaxDistance &&
         (rule.ratio_percent == 0 ||
          100 * nearest.distance() < rule.ratio_percent * nearest.second_distance());
}

void find_matches(const FeatureSet& a, const FeatureSet& b, const MatchRule& rule,
                  Neighbours& found, std::vector<Match>& matches) {
  find_nearest(a.descriptors, b.descriptors, found);
  matches.clear();
  for (std::size_t i = 0; i < found.of_rows.size(); ++i) {
    const Nearest& there = found.of_rows[i];
    if (!is_distinct(there, rule)) continue;  // also where there are no columns at all
    const Nearest& back = found.of_columns[there.index()];
    if (back.index() == i && is_distinct(back, rule)) {
      matches.push_back({a.positions[i], b.positions[there.index()]});
    }
  }
}

bool supports(const Match& one, const Match& other) {
  const int dx_a = other.in_a.x - one.in_a.x;
  const int dy_a = other.in_a.y - one.in_a.y;
  const int dx_b = other.in_b.x - one.in_b.x;
  const int dy_b = other.in_b.y - one.in_b.y;
  return std::abs(dx_a) + std::abs(dy_a) <= kNear && std::abs(dx_b) + std::abs(dy_b) <= kNear &&
         std::abs(dx_b - dx_a) <= kAlike && std::abs(dy_b - dy_a) <= kAlike;
}

bool is_supported(const Match& match, const std::vector<Match>& all, int wanted) {
  int supporters = -1;  // the loop counts the match itself
  for (const Match& other : all) {
    if (supports(match, other) && ++supporters == wanted) return true;
  }
  return false;
}

}  // namespace

int count_matches(const FeatureSet& a, const FeatureSet& b, const MatchRule& rule) {
  assert(a.positions.size() == a.descriptors.size());
  assert(b.positions.size() == b.descriptors.size());
  thread_local Neighbours found;
  thread_local std::vector<Match> matches;
  find_matches(a, b, rule, found, matches);
  return static_cast<int>(std::ranges::count_if(
      matches, [&](const Match& match) { return is_supported(match, matches, rule.supporters); }));
}

int similarity(const FeatureSet& a, const FeatureSet& b) { return count_matches(a, b, {}); }

std::optional<double> image_motion(const FeatureSet& a, const FeatureSet& b) {
  constexpr MatchRule kRule;
  Neighbours found;
  std::vector<Match> matches;
  find_matches(a, b, kRule, found, matches);
  std::vector<int> squares;
  for (const Match& match : matches) {
    if (!is_supported(match, matches, kRule.supporters)) continue;
    const int dx = match.in_b.x - match.in_a.x;
    const int dy = match.in_b.y - match.in_a.y;
    squares.push_back(dx * dx + dy * dy);
  }
  if (squares.empty()) return std::nullopt;
  const auto middle = squares.begin() + static_cast<std::ptrdiff_t>(squares.size() / 2);
  std::ranges::nth_element(squares, middle);
  return std::sqrt(static_cast<double>(*middle)) / ImagePoint::kWidth;
}

}  // namespace orbbuf
