// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/similarity.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cstddef>
#include <cstdint>
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

/// Where `from` has its only nearest neighbour in `to` by the documented rules; -1: nowhere.
int match_of(const Descriptor& from, const std::vector<Descriptor>& to) {
  std::vector<std::pair<int, int>> order;
  order.reserve(to.size());
  for (const Descriptor& other : to) {
    order.emplace_back(bits_between(from, other), static_cast<int>(order.size()));
  }
  std::ranges::sort(order);
  if (order.empty() || order[0].first > 64) return -1;
  if (order.size() > 1 && !(order[0].first < 0.8 * order[1].first)) return -1;
  return order[0].second;
}

int naive_similarity(const FeatureSet& a, const FeatureSet& b) {
  int matches = 0;
  for (std::size_t i = 0; i < a.descriptors.size(); ++i) {
    const int j = match_of(a.descriptors[i], b.descriptors);
    if (j < 0) continue;
    const Descriptor& back = b.descriptors[static_cast<std::size_t>(j)];
    if (match_of(back, a.descriptors) == static_cast<int>(i)) ++matches;
  }
  return matches;
}

class SimilarityTest : public testing::Test {
 protected:
  FeatureSet random_set(int count) {
    FeatureSet set;
    while (count-- > 0) set.descriptors.push_back({random_(), random_(), random_(), random_()});
    return set;
  }
  /// The same features in another order, with up to `bits` of each changed.
  FeatureSet noisy(FeatureSet set, int bits) {
    std::ranges::shuffle(set.descriptors, random_);
    for (Descriptor& descriptor : set.descriptors) {
      for (int i = 0; i < bits; ++i) {
        descriptor[random_() % 4] ^= std::uint64_t{1} << (random_() % 64);
      }
    }
    return set;
  }

  std::mt19937_64 random_{1};
};

TEST_F(SimilarityTest, AFrameMatchesItselfInEveryFeature) {
  for (const int count : {1, 2, 3, 500}) {
    const FeatureSet set = random_set(count);
    EXPECT_EQ(similarity(set, set), count);
  }
}

TEST_F(SimilarityTest, AnEmptySetIsUnlikeEverything) {
  EXPECT_EQ(similarity({}, {}), 0);
  EXPECT_EQ(similarity({}, random_set(10)), 0);
  EXPECT_EQ(similarity(random_set(10), {}), 0);
}

TEST_F(SimilarityTest, UnrelatedFramesMatchInLessThanATwentiethOfTheirFeatures) {
  for (int i = 0; i < 10; ++i) EXPECT_LT(similarity(random_set(500), random_set(500)), 25);
}

TEST_F(SimilarityTest, FindsEveryFeatureAgainDespiteNoise) {
  const FeatureSet set = random_set(500);
  EXPECT_EQ(similarity(set, noisy(set, 30)), 500);
}

TEST_F(SimilarityTest, CountsOnlyTheFeaturesThatFramesShare) {
  FeatureSet a = random_set(300);
  FeatureSet b = noisy(a, 10);
  b.descriptors.resize(120);
  for (const Descriptor& descriptor : random_set(200).descriptors) {
    b.descriptors.push_back(descriptor);
  }
  EXPECT_EQ(similarity(a, b), 120);
}

TEST_F(SimilarityTest, AFeatureThatOccursTwiceMatchesNothing) {
  FeatureSet set = random_set(10);
  set.descriptors.push_back(set.descriptors[3]);
  EXPECT_EQ(similarity(set, set), 9);
}

TEST_F(SimilarityTest, TheNearestOfAllMustBeSixtyFourBitsAwayAtMost) {
  const FeatureSet zero{{Descriptor{}}};
  EXPECT_EQ(similarity(zero, {{Descriptor{~0ULL, 0, 0, 0}}}), 1);
  EXPECT_EQ(similarity(zero, {{Descriptor{~0ULL, 1, 0, 0}}}), 0);
  EXPECT_EQ(similarity(zero, {{Descriptor{~0ULL, ~0ULL, ~0ULL, ~0ULL}}}), 0);
}

TEST_F(SimilarityTest, TheNearestMustBeUnderFourFifthsOfTheSecond) {
  const FeatureSet zero{{Descriptor{}}};
  const Descriptor ten{0x3ff, 0, 0, 0};
  EXPECT_EQ(similarity(zero, {{Descriptor{0xff, 0, 0, 0}, ten}}), 0);
  EXPECT_EQ(similarity(zero, {{Descriptor{0x7f, 0, 0, 0}, ten}}), 1);
}

TEST_F(SimilarityTest, IsSymmetricAndAsDefined) {
  for (int round = 0; round < 200; ++round) {
    const FeatureSet a = random_set(1 + static_cast<int>(random_() % 30));
    FeatureSet b = noisy(a, static_cast<int>(random_() % 90));
    const FeatureSet others = noisy(random_() % 2 ? a : random_set(20), 40);
    b.descriptors.insert(b.descriptors.end(), others.descriptors.begin(), others.descriptors.end());
    EXPECT_EQ(similarity(a, b), naive_similarity(a, b));
    EXPECT_EQ(similarity(a, b), similarity(b, a));
  }
}

}  // namespace
}  // namespace orbbuf
