// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_queue.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace orbbuf {
namespace {

constexpr std::int64_t kAll = std::numeric_limits<std::int64_t>::max();

/// Room for four.
class SampleQueueTest : public ::testing::Test {
 protected:
  void push(std::int64_t first, std::int64_t last) {
    for (std::int64_t time = first; time <= last; ++time) queue_.push({time, {}, {}});
  }
  /// The numbers that are taken.
  std::vector<std::uint64_t> take(std::int64_t upto = kAll) {
    std::vector<std::uint64_t> numbers;
    while (const auto batch = queue_.take(upto)) {
      for (std::size_t i = 0; i < batch->samples.size(); ++i) {
        EXPECT_EQ(batch->samples[i].time_ns, static_cast<std::int64_t>(batch->first + i));
        numbers.push_back(batch->first + i);
      }
    }
    return numbers;
  }
  void expect_account() {
    EXPECT_EQ(queue_.captured(),
              queue_.delivered() + queue_.waiting() + queue_.late() + queue_.lost());
  }
  using Numbers = std::vector<std::uint64_t>;

  SampleQueue queue_{4 * SampleQueue::kBytesPerSample};
};

TEST_F(SampleQueueTest, TakesEachOnceUpToTheTime) {
  push(0, 3);
  EXPECT_EQ(take(1), (Numbers{0, 1}));
  EXPECT_EQ(take(1), Numbers());
  EXPECT_EQ(take(), (Numbers{2, 3}));
  queue_.acknowledge(4);
  EXPECT_TRUE(queue_.is_settled());
  EXPECT_EQ(queue_.delivered(), 4U);
  expect_account();
}

TEST_F(SampleQueueTest, SendsAgainWhatANewServerLacks) {
  push(0, 3);
  take(2);
  queue_.rewind(1);
  EXPECT_EQ(take(), (Numbers{1, 2, 3}));
  EXPECT_EQ(queue_.sent_end(), 4U);
}

TEST_F(SampleQueueTest, AFullQueueLosesTheOldestThatWasNeverSent) {
  push(0, 3);
  take(0);
  queue_.rewind(0);
  push(4, 5);
  EXPECT_EQ(queue_.lost(), 2U);
  EXPECT_EQ(take(), (Numbers{0, 3, 4, 5}));
  queue_.acknowledge(6);
  EXPECT_EQ(queue_.delivered(), 4U);
  expect_account();
}

TEST_F(SampleQueueTest, IfAllWereSentTheOldestIsLost) {
  push(0, 3);
  take();
  push(4, 4);
  EXPECT_EQ(queue_.lost(), 1U);
  EXPECT_EQ(take(), Numbers{4});
  expect_account();
}

TEST_F(SampleQueueTest, WhatTheRecordHasComesLateInsteadOfBeingLost) {
  push(0, 3);
  take(0);
  EXPECT_EQ(queue_.unrecorded().samples.size(), 4U);
  queue_.set_recorded(3);
  EXPECT_EQ(queue_.unrecorded().first, 3U);
  push(4, 6);  // 1 and 2 are late, 3 is lost
  EXPECT_EQ(queue_.late(), 2U);
  EXPECT_EQ(queue_.lost(), 1U);
  EXPECT_EQ(queue_.unrecorded().first, 4U);
  const auto late = queue_.take_late();
  ASSERT_EQ(late.size(), 1U);
  EXPECT_EQ(late.front().begin, 1U);
  EXPECT_EQ(late.front().end, 3U);
  EXPECT_TRUE(queue_.take_late().empty());
  queue_.lose_late(1);
  EXPECT_EQ(queue_.late(), 1U);
  EXPECT_EQ(queue_.lost(), 2U);
  EXPECT_EQ(queue_.first_waiting(), 0U);
  queue_.acknowledge(7);
  EXPECT_EQ(queue_.first_waiting(), 7U);
  EXPECT_TRUE(queue_.unrecorded().samples.empty());
  expect_account();
}

TEST_F(SampleQueueTest, WhatIsNotNewerIsNotTaken) {
  EXPECT_TRUE(queue_.push({5, {}, {}}));
  EXPECT_FALSE(queue_.push({5, {}, {}}));
  EXPECT_EQ(queue_.captured(), 1U);
}

Sample message_of(std::int64_t time_ns, std::size_t bytes) {
  TopicMessage message{std::make_shared<const TopicPublisher>(), time_ns, {}};
  message.cdr.resize(bytes);
  return {time_ns, {}, {}, std::make_shared<const TopicMessage>(std::move(message))};
}

TEST(TopicQueue, AnyTimesAreTakenAndBytesAreTheLimit) {
  SampleQueue queue(10'000);
  for (const std::int64_t time : {5, 5, 3}) EXPECT_TRUE(queue.push(message_of(time, 3000)));
  EXPECT_EQ(queue.lost(), 0U);
  EXPECT_TRUE(queue.push(message_of(6, 3000)));
  EXPECT_EQ(queue.lost(), 1U);
  EXPECT_TRUE(queue.push(message_of(7, 100'000)));  // one may be of any size
  EXPECT_EQ(queue.lost(), 4U);
  EXPECT_EQ(queue.take(kAll)->first, 4U);
  EXPECT_TRUE(queue.push(message_of(8, 10)));
  EXPECT_EQ(queue.waiting(), 1U);
  EXPECT_EQ(queue.captured(), 6U);
}

TEST(TopicQueue, ManyBytesGoInSeveralBatches) {
  SampleQueue queue(1 << 20);
  for (int i = 0; i < 4; ++i) queue.push(message_of(i, 25'000));
  EXPECT_EQ(queue.unrecorded().samples.size(), 2U);
  EXPECT_EQ(queue.take(kAll)->samples.size(), 2U);
  queue.push(message_of(5, 70'000));
  EXPECT_EQ(queue.take(kAll)->samples.size(), 2U);
  EXPECT_EQ(queue.take(kAll)->first, 4U);
  EXPECT_FALSE(queue.take(kAll));
}

TEST(TopicQueue, OfAMessageThatIsTooLongTheNumberIsLost) {
  SampleQueue queue(4 << 20);
  EXPECT_FALSE(queue.push(message_of(1, wire::kMaxTopicMessageBytes + 1)));
  EXPECT_TRUE(queue.push(message_of(2, wire::kMaxTopicMessageBytes)));
  EXPECT_EQ(queue.take(kAll)->first, 1U);
  EXPECT_EQ(queue.lost(), 1U);
  EXPECT_EQ(queue.captured(), 2U);
}

TEST(TopicQueue, OnlyTheLatestWaitsToBeSent) {
  SampleQueue queue(1 << 20, true);
  for (int i = 0; i < 3; ++i) queue.push(message_of(i, 10));
  EXPECT_EQ(queue.take(kAll)->first, 2U);
  for (int i = 3; i < 6; ++i) queue.push(message_of(i, 10));
  EXPECT_EQ(queue.waiting(), 2U);  // what was sent stays
  EXPECT_EQ(queue.take(kAll)->first, 5U);
  queue.rewind(0);
  EXPECT_EQ(queue.take(kAll)->first, 2U);
  EXPECT_EQ(queue.take(kAll)->first, 5U);
  EXPECT_EQ(queue.lost(), 4U);
}

}  // namespace
}  // namespace orbbuf
