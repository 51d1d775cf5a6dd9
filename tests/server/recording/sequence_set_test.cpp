// SPDX-License-Identifier: Apache-2.0
#include "server/recording/sequence_set.hpp"

#include <gtest/gtest.h>

#include <random>
#include <set>

namespace orbbuf {
namespace {

TEST(SequenceSet, ANumberIsInItOnce) {
  SequenceSet numbers;
  EXPECT_TRUE(numbers.empty());
  EXPECT_FALSE(numbers.contains(0));
  EXPECT_TRUE(numbers.insert(0));
  EXPECT_FALSE(numbers.insert(0));
  EXPECT_TRUE(numbers.contains(0));
  EXPECT_FALSE(numbers.contains(1));
  EXPECT_FALSE(numbers.empty());
}

TEST(SequenceSet, NumbersThatFollowEachOtherAreOneRunInAnyOrder) {
  SequenceSet numbers;
  for (const Sequence number : {5U, 7U, 6U, 3U, 4U, 8U, 10U}) EXPECT_TRUE(numbers.insert(number));
  EXPECT_EQ(numbers.runs(), (std::map<Sequence, Sequence>{{3, 9}, {10, 11}}));
}

TEST(SequenceSet, IsASet) {
  std::mt19937 random(1);
  SequenceSet numbers;
  std::set<Sequence> reference;
  for (int i = 0; i < 100'000; ++i) {
    const Sequence number = random() % 1000;
    if (i % 2 == 0 && i < 1200) {
      ASSERT_EQ(numbers.insert(number), reference.insert(number).second);
    }
    ASSERT_EQ(numbers.contains(number), reference.contains(number));
  }
  Sequence count = 0;
  for (const auto& [first, end] : numbers.runs()) count += end - first;
  EXPECT_EQ(count, reference.size());
}

}  // namespace
}  // namespace orbbuf
