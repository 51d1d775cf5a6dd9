// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/given_up.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

constexpr std::size_t kMost = 1024;

std::vector<DropRecord> records(Sequence first, std::size_t count) {
  std::vector<DropRecord> all;
  for (std::size_t i = 0; i < count; ++i) {
    all.push_back({first + i, static_cast<std::int64_t>(i), DropReason::kPolicy});
  }
  return all;
}

TEST(GivenUp, RecordsAreNumberedAndKeptUntilAcknowledged) {
  GivenUp given_up;
  EXPECT_TRUE(given_up.is_settled());
  EXPECT_FALSE(given_up.has_unsent());
  given_up.add(records(10, 3));
  const auto items = given_up.take_unsent(kMost);
  EXPECT_EQ(items.first, 0U);
  EXPECT_EQ(items.records, records(10, 3));
  EXPECT_FALSE(given_up.has_unsent());
  given_up.acknowledge(2);
  EXPECT_FALSE(given_up.is_settled());
  given_up.acknowledge(3);
  EXPECT_TRUE(given_up.is_settled());
  EXPECT_EQ(given_up.end(), 3U);
}

TEST(GivenUp, NewConnectionSendsAgainWhatTheServerDoesNotHave) {
  GivenUp given_up;
  given_up.add(records(0, 5));
  given_up.take_unsent(kMost);
  given_up.rewind(2);
  auto again = given_up.take_unsent(kMost);
  EXPECT_EQ(again.first, 2U);
  EXPECT_EQ(again.records.front().sequence, 2U);
  EXPECT_EQ(again.records.size(), 3U);
  given_up.rewind(1);  // it has lost one that it had acknowledged
  again = given_up.take_unsent(kMost);
  EXPECT_EQ(again.first, 1U);
  EXPECT_EQ(again.records.size(), 4U);
  EXPECT_EQ(given_up.end(), 5U);
}

/// What was sent once keeps its number, whatever its records touch.
TEST(GivenUp, ANumberStaysWithItsRecord) {
  GivenUp given_up;
  given_up.add(records(0, DropRanges::kMostExact));
  const auto sent = given_up.take_unsent(kMost);
  given_up.add(records(DropRanges::kMostExact, kMost));
  given_up.rewind(0);
  const auto again = given_up.take_unsent(kMost);
  EXPECT_EQ(again.first, sent.first);
  EXPECT_EQ(again.records, sent.records);
}

TEST(GivenUp, AMessageIsNeverLongerThanTheProtocolAllows) {
  GivenUp given_up;
  given_up.add(records(0, kMost + 1));
  EXPECT_EQ(given_up.take_unsent(kMost).records.size(), kMost);
  given_up.acknowledge(1);
  EXPECT_TRUE(given_up.has_unsent());
  const auto rest = given_up.take_unsent(kMost);
  EXPECT_EQ(rest.first, kMost);
  EXPECT_EQ(rest.records.size(), 1U);
  EXPECT_FALSE(given_up.has_unsent());
}

TEST(GivenUp, OnlyTheNewestAcknowledgedOnesCanBeSentAgain) {
  GivenUp given_up;
  for (Sequence i = 0; i < GivenUp::kMostKept + 10; ++i) {
    given_up.add(records(i, 1));  // what waits may be joined
    given_up.take_unsent(kMost);
    given_up.acknowledge(i);
  }
  given_up.acknowledge(GivenUp::kMostKept + 10);
  given_up.rewind(0);
  EXPECT_EQ(given_up.take_unsent(kMost).first, 10U);
}

/// A server that acknowledges none cannot make the robot keep them all.
TEST(GivenUp, NoMoreAreNumberedThanMayWaitForTheServer) {
  GivenUp given_up;
  for (Sequence i = 0; i < GivenUp::kMostKept + 10; ++i) {
    given_up.add(records(i, 1));
    if (given_up.has_unsent()) given_up.take_unsent(kMost);
  }
  EXPECT_EQ(given_up.end(), GivenUp::kMostKept);
  EXPECT_FALSE(given_up.has_unsent());
  EXPECT_FALSE(given_up.is_settled());
  given_up.acknowledge(1);
  ASSERT_TRUE(given_up.has_unsent());
  EXPECT_EQ(given_up.take_unsent(kMost).records.front().sequence, GivenUp::kMostKept);
  given_up.rewind(1);
  while (given_up.has_unsent()) given_up.take_unsent(kMost);
  EXPECT_EQ(given_up.end(), GivenUp::kMostKept + 1);
}

TEST(GivenUp, AFrameIsSettledWhenAllBelowItAre) {
  GivenUp given_up;
  EXPECT_EQ(given_up.settled_below(100), 100U);
  given_up.add(records(40, 3));
  EXPECT_EQ(given_up.settled_below(100), 40U);
  EXPECT_EQ(given_up.settled_below(7), 7U);
  given_up.take_unsent(kMost);
  EXPECT_EQ(given_up.settled_below(100), 40U);
  given_up.acknowledge(2);
  EXPECT_EQ(given_up.settled_below(100), 42U);
  given_up.add(records(41, 1));  // the server has lost it
  EXPECT_EQ(given_up.settled_below(100), 41U);
}

}  // namespace
}  // namespace orbbuf
