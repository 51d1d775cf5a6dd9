// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/drop_log.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

std::vector<DropRecord> records(Sequence first, std::size_t count) {
  std::vector<DropRecord> all;
  for (std::size_t i = 0; i < count; ++i) {
    all.push_back({first + i, static_cast<std::int64_t>(i), DropReason::kPolicy});
  }
  return all;
}

TEST(DropLog, RecordsAreNumberedAndKeptUntilAcknowledged) {
  DropLog log;
  EXPECT_TRUE(log.is_settled());
  EXPECT_FALSE(log.has_unsent());
  log.add(records(10, 3));
  EXPECT_EQ(log.take_unsent(), (wire::Dropped{0, records(10, 3)}));
  EXPECT_FALSE(log.has_unsent());
  EXPECT_FALSE(log.is_settled());
  log.acknowledge(2);
  EXPECT_FALSE(log.is_settled());
  log.acknowledge(3);
  EXPECT_TRUE(log.is_settled());
  EXPECT_EQ(log.next_drop(), 3U);
}

TEST(DropLog, NewConnectionSendsAgainWhatTheServerDoesNotHave) {
  DropLog log;
  log.add(records(0, 5));
  log.take_unsent();
  log.rewind(2);
  const wire::Dropped again = log.take_unsent();
  EXPECT_EQ(again.first_drop, 2U);
  ASSERT_EQ(again.records.size(), 3U);
  EXPECT_EQ(again.records[0].sequence, 2U);
  log.rewind(1);  // it has lost one that it had acknowledged
  const std::vector<DropRecord> all = records(0, 5);
  EXPECT_EQ(log.take_unsent(), (wire::Dropped{1, {all.begin() + 1, all.end()}}));
  EXPECT_EQ(log.next_drop(), 5U);
}

TEST(DropLog, MessageIsNeverLongerThanTheProtocolAllows) {
  DropLog log;
  log.add(records(0, wire::kMaxDropsPerMessage + 1));
  EXPECT_EQ(log.take_unsent().records.size(), wire::kMaxDropsPerMessage);
  log.acknowledge(1);
  EXPECT_TRUE(log.has_unsent());
  EXPECT_EQ(log.take_unsent().first_drop, wire::kMaxDropsPerMessage);
  EXPECT_FALSE(log.has_unsent());
}

TEST(DropLog, AcknowledgementFromBeyondTheEndSettlesAllAndNoMore) {
  DropLog log;
  log.add(records(0, 2));
  log.acknowledge(99);
  EXPECT_TRUE(log.is_settled());
  EXPECT_EQ(log.next_drop(), 2U);
}

}  // namespace
}  // namespace orbbuf
