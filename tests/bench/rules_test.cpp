// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/rules.hpp"

#include <gtest/gtest.h>

#include <random>

namespace orbbuf::sim {
namespace {

/// 60 features, 40 of them the first 40 of `of` with a few bits changed, moved together.
FeatureSet related(std::mt19937_64& random, const FeatureSet& of) {
  FeatureSet set;
  for (int i = 0; i < 60; ++i) {
    const auto k = static_cast<std::size_t>(i);
    Descriptor descriptor = {random(), random(), random(), random()};
    ImagePoint position{static_cast<std::int16_t>(random() % 1024),
                        static_cast<std::int16_t>(random() % 768)};
    if (i < 40 && k < of.descriptors.size()) {
      descriptor = of.descriptors[k];
      descriptor[random() % 4] ^= random() & random() & random();
      position.x = static_cast<std::int16_t>(of.positions[k].x + 9);
    }
    set.add(descriptor, position);
  }
  return set;
}

TEST(Rules, TheLastIsM) {
  std::mt19937_64 random(1);
  for (int round = 0; round < 100; ++round) {
    const FeatureSet a = related(random, {});
    const FeatureSet b = related(random, a);
    EXPECT_EQ(count_matches(a, b, kRules.back().match), similarity(a, b));
  }
}

TEST(Rules, EachIsStricterThanTheOneWithoutIt) {
  std::mt19937_64 random(2);
  const FeatureSet a = related(random, {});
  const FeatureSet b = related(random, a);
  EXPECT_GE(count_matches(a, b, kRules[0].match), count_matches(a, b, kRules[2].match));
  EXPECT_GE(count_matches(a, b, kRules[2].match), count_matches(a, b, kRules[1].match));
  EXPECT_GE(count_matches(a, b, kRules[2].match), count_matches(a, b, kRules[3].match));
  EXPECT_GT(count_matches(a, b, kRules[3].match), 0);
}

}  // namespace
}  // namespace orbbuf::sim
