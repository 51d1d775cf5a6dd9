// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/drop_queue.hpp"

#include <gtest/gtest.h>

#include <random>

#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

std::vector<DropRecord> records_from(Sequence first, std::size_t count) {
  std::vector<DropRecord> all;
  for (Sequence at = first; at < first + count; ++at) {
    all.push_back({at, -static_cast<std::int64_t>(at), DropReason::kBusy,
                   static_cast<std::uint16_t>(at % 500)});
  }
  return all;
}

/// Pops all, in steps of `step`, and checks that the records are those from `first` on.
void expect_all_from(DropQueue& queue, Sequence first, std::size_t step) {
  while (queue.size() > 0) {
    ASSERT_FALSE(queue.oldest().empty());
    ASSERT_EQ(queue.oldest().front(), records_from(first, 1)[0]);
    first += std::min<std::uint64_t>(step, queue.size());
    queue.pop(step);
  }
}

TEST(DropQueue, TheFileHoldsWhatTheMemoryDoesNot) {
  const test::TemporaryFolder folder;
  for (const std::size_t count : {1U, 3U, 4U, 5U, 100U}) {
    DropQueue queue(folder.path(), 4);
    queue.push(records_from(0, count));
    EXPECT_EQ(queue.size(), count);
    EXPECT_LE(queue.oldest().size(), 4U);
    for (const std::size_t step : {1U, 3U, 4U, 7U}) {
      DropQueue other(folder.path(), 4);
      other.push(records_from(5, count));
      expect_all_from(other, 5, step);
    }
    EXPECT_TRUE(std::filesystem::is_empty(folder.path())) << "the file has no name";
  }
}

TEST(DropQueue, IsEqualToAPlainListThroughARandomRun) {
  const test::TemporaryFolder folder;
  DropQueue queue(folder.path(), 16);
  std::mt19937 random(1);
  Sequence pushed = 0, popped = 0;
  for (int i = 0; i < 20'000; ++i) {
    const std::size_t count = random() % 40;
    if (random() % 2 == 0) {
      queue.push(records_from(pushed, count));
      pushed += count;
    } else {
      popped += std::min<std::uint64_t>(count, pushed - popped);
      queue.pop(count);
    }
    ASSERT_EQ(queue.size(), pushed - popped);
    ASSERT_LE(queue.oldest().size(), 16U);
    ASSERT_EQ(queue.oldest().empty(), pushed == popped);
    Sequence at = popped;
    for (const DropRecord& record : queue.oldest()) ASSERT_EQ(record, records_from(at++, 1)[0]);
  }
}

TEST(DropQueue, WithoutAFileTheRecordsStayInMemory) {
  const test::CapturedLog log;
  DropQueue queue("/nowhere", 4);
  for (Sequence at = 0; at < 50; at += 5) queue.push(records_from(at, 5));
  EXPECT_EQ(queue.size(), 50U);
  EXPECT_EQ(log.lines("cannot make a file for drop records in /nowhere: ").size(), 1U);
  EXPECT_EQ(log.lines().size(), 1U);
  expect_all_from(queue, 0, 3);
}

}  // namespace
}  // namespace orbbuf
