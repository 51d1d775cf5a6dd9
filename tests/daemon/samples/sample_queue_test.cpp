// SPDX-License-Identifier: Apache-2.0
#include "daemon/samples/sample_queue.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <initializer_list>
#include <limits>
#include <vector>

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

TEST_F(SampleQueueTest, WhatIsNotNewerIsLost) {
  EXPECT_TRUE(queue_.push({5, {}, {}}));
  EXPECT_FALSE(queue_.push({5, {}, {}}));
  EXPECT_TRUE(queue_.push({6, {}, {}}));
  EXPECT_EQ(queue_.captured(), 3U);
  EXPECT_EQ(queue_.lost(), 1U);
  EXPECT_EQ(queue_.refused(), 1U);
  EXPECT_EQ(queue_.take(kAll)->first, 0U);
  EXPECT_EQ(queue_.take(kAll)->first, 2U);
  expect_account();
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
  SampleQueue queue(1 << 20, TopicPolicy::kLatest);
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

TEST(TopicQueue, WhatMayBeGivenUpIsNotForTheRecord) {
  for (const TopicPolicy policy : {TopicPolicy::kLatest, TopicPolicy::kFrames}) {
    SampleQueue queue(1 << 20, policy, std::chrono::nanoseconds(10));
    queue.push(message_of(10, 10));
    EXPECT_TRUE(queue.unrecorded().samples.empty());
    queue.on_frame_sent(10);
    queue.take(kAll);
    EXPECT_EQ(queue.unrecorded().samples.size(), 1U);
    queue.set_recorded(1);
    queue.push(message_of(20, 10));
    EXPECT_TRUE(queue.unrecorded().samples.empty());
  }
}

/// Depth images of frames that are 10 ns apart.
class TopicOfFramesTest : public ::testing::Test {
 protected:
  void push(std::initializer_list<std::int64_t> times) {
    for (const std::int64_t time : times) EXPECT_TRUE(queue_.push(message_of(time, 100)));
  }
  std::vector<std::int64_t> take() {
    std::vector<std::int64_t> times;
    while (const auto batch = queue_.take(0)) {
      for (const Sample& sample : batch->samples) times.push_back(sample.time_ns);
    }
    return times;
  }
  using Times = std::vector<std::int64_t>;

  SampleQueue queue_{1 << 20, TopicPolicy::kFrames, std::chrono::nanoseconds(10)};
};

TEST_F(TopicOfFramesTest, WhatIsOfAFrameGoesWhenItGoes) {
  push({10, 20, 31});
  EXPECT_FALSE(queue_.has_due());
  EXPECT_EQ(take(), Times());
  queue_.on_frame_sent(20);
  EXPECT_EQ(queue_.lost(), 1U);  // of the frame before, which was passed over
  EXPECT_TRUE(queue_.has_due());
  EXPECT_EQ(take(), Times{20});
  EXPECT_FALSE(queue_.has_due());
  queue_.on_frame_sent(30);
  EXPECT_EQ(take(), Times{31});
}

TEST_F(TopicOfFramesTest, WhatComesBehindItsFrameGoesAtOnce) {
  for (const std::int64_t frame : {10, 30, 40}) queue_.on_frame_sent(frame);
  push({11, 20, 41, 50});
  EXPECT_EQ(queue_.lost(), 1U);
  EXPECT_TRUE(queue_.has_due());
  EXPECT_EQ(take(), (Times{11, 41}));
  EXPECT_EQ(queue_.waiting(), 3U);
}

TEST_F(TopicOfFramesTest, WhatIsOfDroppedFramesIsGivenUp) {
  push({10, 20, 30, 40});
  queue_.on_frames_dropped(20, 30);
  EXPECT_EQ(queue_.lost(), 2U);
  queue_.on_frame_sent(10);
  queue_.on_frame_sent(40);
  EXPECT_EQ(take(), (Times{10, 40}));
  push({44});
  queue_.on_frames_dropped(40, 40);  // too late
  queue_.on_frames_dropped(50, 50);  // the neighbour
  queue_.rewind(0);
  EXPECT_EQ(take(), (Times{10, 40, 44}));
  EXPECT_EQ(queue_.lost(), 2U);
}

TEST_F(TopicOfFramesTest, BehindTheLastFrameTheRestIsGivenUp) {
  push({10, 20, 30});
  queue_.on_frame_sent(20);
  queue_.on_last_frame_sent();
  EXPECT_EQ(take(), Times{20});
  queue_.acknowledge(2);
  EXPECT_TRUE(queue_.is_settled());
  EXPECT_EQ(queue_.lost(), 2U);
  EXPECT_EQ(queue_.delivered(), 1U);
}

TEST_F(TopicOfFramesTest, WhatTheRecordHasComesLate) {
  push({10, 20});
  queue_.set_recorded(2);
  queue_.on_frame_sent(20);
  EXPECT_EQ(queue_.lost(), 0U);
  EXPECT_EQ(queue_.late(), 1U);
}

TEST(TopicQueue, FramesDoNotMatterToOtherPolicies) {
  SampleQueue queue(1 << 20);
  queue.push(message_of(10, 10));
  queue.on_frames_dropped(10, 10);
  queue.on_frame_sent(20);
  queue.on_last_frame_sent();
  EXPECT_EQ(queue.lost(), 0U);
  EXPECT_TRUE(queue.take(kAll));
}

}  // namespace
}  // namespace orbbuf
