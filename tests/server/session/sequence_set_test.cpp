// SPDX-License-Identifier: Apache-2.0
#include "server/session/sequence_set.hpp"

#include <gtest/gtest.h>

#include <random>
#include <set>

namespace orbbuf {
namespace {

TEST(SequenceSet, ANumberIsInItOnce) {
  SequenceSet set;
  EXPECT_TRUE(set.empty());
  for (const Sequence number : {0U, 63U, 64U, 4095U, 4096U, 1'000'000U}) {
    EXPECT_FALSE(set.contains(number));
    EXPECT_TRUE(set.insert(number));
    EXPECT_FALSE(set.insert(number));
    EXPECT_TRUE(set.contains(number));
  }
  EXPECT_FALSE(set.contains(1));
}

TEST(SequenceSet, IsASet) {
  std::mt19937 random(1);
  for (const Sequence range : {200U, 20'000U, 2'000'000U}) {
    SequenceSet set;
    std::set<Sequence> naive;
    for (int i = 0; i < 1000; ++i) {
      const Sequence number = random() % range;
      EXPECT_EQ(set.insert(number), naive.insert(number).second);
      const Sequence from = random() % range;
      const Sequence limit = random() % range;
      const auto in = naive.lower_bound(from);
      EXPECT_EQ(set.next_in(from, limit), in == naive.end() || *in >= limit ? limit : *in);
      Sequence out = from;
      while (out < limit && naive.contains(out)) ++out;
      EXPECT_EQ(set.next_out(from, limit), out < limit ? out : limit);
    }
  }
}

TEST(SequenceSet, RunsEndWhereTheyEnd) {
  SequenceSet set;
  for (Sequence i = 100; i < 10'000; ++i) set.insert(i);
  EXPECT_EQ(set.next_out(100, 1U << 20), 10'000U);
  EXPECT_EQ(set.next_out(100, 5000), 5000U);
  EXPECT_EQ(set.next_in(0, 1U << 20), 100U);
  EXPECT_EQ(set.next_in(10'000, Sequence{1} << 60), Sequence{1} << 60);
}

}  // namespace
}  // namespace orbbuf
