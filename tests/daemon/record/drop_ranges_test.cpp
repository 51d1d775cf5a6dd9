// SPDX-License-Identifier: Apache-2.0
#include "daemon/record/drop_ranges.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <map>
#include <numeric>
#include <random>
#include <vector>

namespace orbbuf {
namespace {

constexpr auto kPolicy = DropReason::kPolicy;
constexpr auto kBusy = DropReason::kBusy;

DropRecord one(Sequence sequence, DropReason reason = kPolicy) {
  return {sequence, static_cast<std::int64_t>(sequence) * 10, reason, 7};
}

DropRecord many(Sequence first, Sequence end, DropReason reason = kPolicy) {
  DropRecord record = one(first, reason);
  record.frames = end - first;
  record.last_capture_time_ns = static_cast<std::int64_t>(end - 1) * 10;
  return record;
}

std::vector<DropRecord> all(const DropRanges& ranges) {
  std::vector<DropRecord> records;
  for (const auto& [first, record] : ranges.by_number()) {
    EXPECT_EQ(first, record.sequence);
    records.push_back(record);
  }
  return records;
}

TEST(DropRanges, FewRecordsStayAsTheyAreByNumber) {
  DropRanges ranges;
  EXPECT_TRUE(ranges.is_empty());
  for (const Sequence sequence : {7U, 3U, 4U, 9U}) ranges.add(one(sequence));
  EXPECT_THAT(all(ranges), testing::ElementsAre(one(3), one(4), one(7), one(9)));
  EXPECT_EQ(ranges.take_first(), one(3));
  EXPECT_EQ(ranges.size(), 3U);
}

TEST(DropRanges, ANumberIsThereOnce) {
  DropRanges ranges;
  ranges.add(one(5, kBusy));
  ranges.add(one(5));
  EXPECT_THAT(all(ranges), testing::ElementsAre(one(5, kBusy)));
}

TEST(DropRanges, OfARangeOnlyWhatIsNotThereIsAdded) {
  DropRanges ranges;
  ranges.add(many(3, 5, kBusy));
  ranges.add(one(7, kBusy));
  ranges.add(many(0, 10));
  const auto records = all(ranges);
  ASSERT_EQ(records.size(), 5U);
  EXPECT_EQ(records[0], many(0, 3));
  EXPECT_EQ(records[1], many(3, 5, kBusy));
  EXPECT_EQ(records[2].end(), 7U);
  EXPECT_EQ(records[2].capture_time_of(5), 50);
  EXPECT_EQ(records[3], one(7, kBusy));
  EXPECT_EQ(records[4], many(8, 10));
}

TEST(DropRanges, RemovesThoseThatEndBelowANumber) {
  DropRanges ranges;
  ranges.add(one(1));
  ranges.add(many(2, 6));
  ranges.add(one(8));
  ranges.remove_below(1);
  EXPECT_EQ(ranges.size(), 3U);
  ranges.remove_below(5);
  EXPECT_THAT(all(ranges), testing::ElementsAre(many(2, 6), one(8)));
  ranges.remove_below(6);
  EXPECT_THAT(all(ranges), testing::ElementsAre(one(8)));
}

/// 3.5 hours at 25 frames a second, of which a store of 1000 frames keeps some everywhere.
TEST(DropRanges, ALongOutageHasFewRecordsAndAllNumbers) {
  constexpr Sequence kFrames = 331'020;
  std::vector<Sequence> order(kFrames);
  std::iota(order.begin(), order.end(), 0);
  std::shuffle(order.begin(), order.end(), std::mt19937(1));  // NOLINT: repeatable
  DropRanges ranges;
  for (const Sequence sequence : order) {
    if (sequence % 331 != 0) ranges.add(one(sequence));
  }
  EXPECT_LE(ranges.size(), DropRanges::kMostExact + kFrames / 331 + 1);
  Sequence next = 0;
  for (const DropRecord& record : all(ranges)) {
    if (next % 331 == 0) ++next;
    EXPECT_EQ(record.sequence, next);
    EXPECT_EQ(record.capture_time_of(record.end() - 1),
              static_cast<std::int64_t>(record.end() - 1) * 10);
    next = record.end();
  }
  EXPECT_EQ(next, kFrames);
}

TEST(DropRanges, BeyondItsLimitReasonsJoin) {
  DropRanges ranges;
  for (Sequence i = 0; i < 2 * DropRanges::kMostReasons; ++i) {
    ranges.add(one(i, i % 2 == 0 ? kPolicy : kBusy));
  }
  EXPECT_EQ(ranges.size(), DropRanges::kMostReasons);
  EXPECT_EQ(all(ranges).back().end(), 2 * DropRanges::kMostReasons);
}

TEST(DropRanges, DoesAsAMapOfNumbersDoes) {
  std::mt19937 random(1);  // NOLINT: repeatable
  DropRanges ranges;
  std::map<Sequence, DropReason> expected;
  for (int step = 0; step < 100'000; ++step) {
    const Sequence first = random() % 200'000;
    const DropReason reason = random() % 4 == 0 ? kBusy : kPolicy;
    const Sequence end = first + 1 + random() % 5;
    ranges.add(many(first, end, reason));
    for (Sequence number = first; number < end; ++number) expected.emplace(number, reason);
  }
  for (const DropRecord& record : all(ranges)) {
    for (Sequence number = record.sequence; number < record.end(); ++number) {
      const auto found = expected.find(number);
      ASSERT_NE(found, expected.end()) << number;
      EXPECT_EQ(found->second, record.reason) << number;
      EXPECT_EQ(record.capture_time_of(number), static_cast<std::int64_t>(number) * 10);
      expected.erase(found);
    }
  }
  EXPECT_TRUE(expected.empty());
}

}  // namespace
}  // namespace orbbuf
