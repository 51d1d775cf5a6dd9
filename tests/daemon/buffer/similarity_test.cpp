// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/similarity.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <numeric>
#include <optional>
#include <random>
#include <utility>
#include <vector>

namespace orbbuf {
namespace {

int bits_between(const Descriptor& a, const Descriptor& b) {
  int bits = 0;
  for (std::size_t i = 0; i < a.size(); ++i) bits += std::popcount(a[i] ^ b[i]);
  return bits;
}

/// Where `from` has its only nearest neighbour in `to` by the documented rules;
/// -1: nowhere.
int match_of(const Descriptor& from, const std::vector<Descriptor>& to) {
  std::vector<std::pair<int, int>> order;
  order.reserve(to.size());
  for (const Descriptor& other : to) {
    order.emplace_back(bits_between(from, other), static_cast<int>(order.size()));
  }
  std::ranges::sort(order);
  if (order.empty() || order[0].first > 64) return -1;
  if (order.size() > 1 && !(order[0].first < 0.9 * order[1].first)) return -1;
  return order[0].second;
}

struct Motion {
  ImagePoint from;
  ImagePoint to;
};

bool naive_support(const Motion& one, const Motion& other) {
  const auto distance = [](const ImagePoint& p, const ImagePoint& q) {
    return std::abs(p.x - q.x) + std::abs(p.y - q.y);
  };
  const int turn_x = (one.to.x - one.from.x) - (other.to.x - other.from.x);
  const int turn_y = (one.to.y - one.from.y) - (other.to.y - other.from.y);
  return distance(one.from, other.from) <= 184 && distance(one.to, other.to) <= 184 &&
         std::abs(turn_x) <= 30 && std::abs(turn_y) <= 30;
}

int naive_similarity(const FeatureSet& a, const FeatureSet& b) {
  std::vector<Motion> motions;
  for (std::size_t i = 0; i < a.descriptors.size(); ++i) {
    const int j = match_of(a.descriptors[i], b.descriptors);
    if (j < 0) continue;
    const auto there = static_cast<std::size_t>(j);
    if (match_of(b.descriptors[there], a.descriptors) != static_cast<int>(i)) continue;
    motions.push_back({a.positions[i], b.positions[there]});
  }
  int matches = 0;
  for (std::size_t i = 0; i < motions.size(); ++i) {
    int supporters = 0;
    for (std::size_t j = 0; j < motions.size(); ++j) {
      if (j != i && naive_support(motions[i], motions[j])) ++supporters;
    }
    if (supporters >= 2) ++matches;
  }
  return matches;
}

class SimilarityTest : public testing::Test {
 protected:
  Descriptor random_descriptor() { return {random_(), random_(), random_(), random_()}; }

  /// Within a square of `side`, in units of ImagePoint.
  FeatureSet random_set(int count, std::uint64_t side = 90) {
    FeatureSet set;
    while (count-- > 0) {
      const auto x = static_cast<std::int16_t>(random_() % side);
      set.add(random_descriptor(), {x, static_cast<std::int16_t>(random_() % side)});
    }
    return set;
  }
  /// The same features in another order, with up to `bits` of each changed.
  FeatureSet noisy(const FeatureSet& set, int bits) {
    std::vector<std::size_t> order(set.descriptors.size());
    std::iota(order.begin(), order.end(), 0U);
    std::ranges::shuffle(order, random_);
    FeatureSet result;
    for (const std::size_t i : order) {
      Descriptor descriptor = set.descriptors[i];
      for (int k = 0; k < bits; ++k) {
        descriptor[random_() % 4] ^= std::uint64_t{1} << (random_() % 64);
      }
      result.add(descriptor, set.positions[i]);
    }
    return result;
  }
  static FeatureSet joined(FeatureSet set, const FeatureSet& more) {
    for (std::size_t i = 0; i < more.descriptors.size(); ++i) {
      set.add(more.descriptors[i], more.positions[i]);
    }
    return set;
  }
  /// How many match of one feature and two that certainly do and would support
  /// it: 3 or, since two do not support each other, 0.
  int with_two_supporters(const Descriptor& a, std::vector<Descriptor> b) {
    const FeatureSet supporters = random_set(2, 1);
    FeatureSet one;
    one.add(a, {});
    FeatureSet other;
    for (const Descriptor& descriptor : b) other.add(descriptor, {});
    return similarity(joined(supporters, one), joined(supporters, other));
  }
  /// How many match of three features, two of them at the origin in both images
  /// and one that moves from (x, y) by (dx, dy).
  int with_a_third(int x, int y, int dx, int dy) {
    const FeatureSet two = random_set(2, 1);
    const Descriptor third = random_descriptor();
    FeatureSet a = two;
    FeatureSet b = two;
    a.add(third, {static_cast<std::int16_t>(x), static_cast<std::int16_t>(y)});
    b.add(third, {static_cast<std::int16_t>(x + dx), static_cast<std::int16_t>(y + dy)});
    EXPECT_EQ(similarity(a, b), similarity(b, a));
    return similarity(a, b);
  }

  std::mt19937_64 random_{1};
};

TEST_F(SimilarityTest, ImageMotionIsTheMedianDisplacementOfTheMatches) {
  const FeatureSet set = random_set(100);
  EXPECT_EQ(image_motion(set, set), 0.0);
  FeatureSet moved = set;
  for (ImagePoint& point : moved.positions) {
    point.x = static_cast<std::int16_t>(point.x + 30);
    point.y = static_cast<std::int16_t>(point.y - 40);
  }
  EXPECT_EQ(image_motion(set, moved), 50.0 / ImagePoint::kWidth);
  EXPECT_EQ(image_motion(moved, set), 50.0 / ImagePoint::kWidth);
}

TEST_F(SimilarityTest, WithoutMatchesThereIsNoImageMotion) {
  EXPECT_EQ(image_motion(random_set(100), random_set(100)), std::nullopt);
  EXPECT_EQ(image_motion({}, random_set(100)), std::nullopt);
}

TEST_F(SimilarityTest, AFrameMatchesItselfInEveryFeature) {
  for (const int count : {3, 4, 500}) {
    const FeatureSet set = random_set(count);
    EXPECT_EQ(similarity(set, set), count);
  }
}

TEST_F(SimilarityTest, ASetOfLessThanThreeIsUnlikeEverything) {
  EXPECT_EQ(similarity({}, {}), 0);
  EXPECT_EQ(similarity({}, random_set(10)), 0);
  EXPECT_EQ(similarity(random_set(10), {}), 0);
  const FeatureSet two = random_set(2);
  EXPECT_EQ(similarity(two, two), 0);
}

TEST_F(SimilarityTest, UnrelatedFramesMatchInLessThanATwentiethOfTheirFeatures) {
  for (int i = 0; i < 10; ++i) EXPECT_LT(similarity(random_set(500), random_set(500)), 25);
}

TEST_F(SimilarityTest, FindsEveryFeatureAgainDespiteNoise) {
  const FeatureSet set = random_set(500);
  EXPECT_EQ(similarity(set, noisy(set, 30)), 500);
}

TEST_F(SimilarityTest, CountsOnlyTheFeaturesThatFramesShare) {
  const FeatureSet shared = random_set(120);
  EXPECT_EQ(similarity(joined(shared, random_set(180)), joined(noisy(shared, 10), random_set(200))),
            120);
}

TEST_F(SimilarityTest, AFeatureThatOccursTwiceMatchesNothing) {
  FeatureSet set = random_set(10);
  set.add(set.descriptors[3], set.positions[3]);
  EXPECT_EQ(similarity(set, set), 9);
}

TEST_F(SimilarityTest, TheNearestOfAllMustBeSixtyFourBitsAwayAtMost) {
  EXPECT_EQ(with_two_supporters({}, {Descriptor{~0ULL, 0, 0, 0}}), 3);
  EXPECT_EQ(with_two_supporters({}, {Descriptor{~0ULL, 1, 0, 0}}), 0);
  EXPECT_EQ(with_two_supporters({}, {Descriptor{~0ULL, ~0ULL, ~0ULL, ~0ULL}}), 0);
}

TEST_F(SimilarityTest, TheNearestMustBeUnderNineTenthsOfTheSecond) {
  const Descriptor ten{0x3ff, 0, 0, 0};
  EXPECT_EQ(with_two_supporters({}, {Descriptor{0x1ff, 0, 0, 0}, ten}), 0);
  EXPECT_EQ(with_two_supporters({}, {Descriptor{0xff, 0, 0, 0}, ten}), 3);
}

TEST_F(SimilarityTest, AMatchMustHaveMovedAsTwoNearItHave) {
  EXPECT_EQ(with_a_third(0, 0, 30, -30), 3);
  EXPECT_EQ(with_a_third(0, 0, 31, 0), 0);
  EXPECT_EQ(with_a_third(0, 0, 0, -31), 0);
}

TEST_F(SimilarityTest, SupportersAreNearInBothImages) {
  EXPECT_EQ(with_a_third(100, 84, 0, 0), 3);
  EXPECT_EQ(with_a_third(101, 84, 0, 0), 0);
  EXPECT_EQ(with_a_third(100, 84, 1, 0), 0);
  EXPECT_EQ(with_a_third(100, 85, 0, -1), 0);
}

TEST_F(SimilarityTest, IsSymmetricAndAsDefined) {
  for (int round = 0; round < 200; ++round) {
    const FeatureSet a = random_set(1 + static_cast<int>(random_() % 30), 400);
    const FeatureSet others = noisy(random_() % 2 ? a : random_set(20, 400), 40);
    const FeatureSet b = joined(noisy(a, static_cast<int>(random_() % 90)), others);
    EXPECT_EQ(similarity(a, b), naive_similarity(a, b));
    EXPECT_EQ(similarity(a, b), similarity(b, a));
  }
}

}  // namespace
}  // namespace orbbuf
