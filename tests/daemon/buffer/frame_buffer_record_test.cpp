// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <limits>
#include <memory>
#include <vector>

#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/buffer/simple_policies.hpp"
#include "tests/daemon/buffer/frames.hpp"

namespace orbbuf {
namespace {

using Numbers = std::vector<Sequence>;

/// A buffer for three frames, which gives up the oldest, with a record that keeps frames.
class FrameBufferRecordTest : public testing::Test {
 protected:
  FrameBufferRecordTest() { buffer_.keep_for_record(); }
  void push(Sequence first, Sequence last) {
    for (Sequence i = first; i <= last; ++i) capture_and_push(buffer_, i);
  }
  void take(int count) {
    while (count-- > 0) ASSERT_TRUE(buffer_.take());
  }
  Numbers collect(bool those_at_risk = false) {
    buffer_.collect_for_record(record_, those_at_risk);
    Numbers numbers;
    for (const FramePtr& frame : record_.frames) numbers.push_back(frame->sequence);
    return numbers;
  }
  Sequence first_undelivered() {
    collect();
    return record_.first_undelivered;
  }
  const Numbers& delivered() const { return record_.delivered; }

  FrameBuffer buffer_{{3}, std::make_unique<DropOldestPolicy>()};
  FrameBuffer::ForRecord record_;
};

TEST_F(FrameBufferRecordTest, CollectsWhatThePolicyDropsAndNothingElse) {
  EXPECT_EQ(collect(), Numbers{});
  push(0, 2);
  EXPECT_EQ(collect(), Numbers{});
  push(3, 4);
  EXPECT_EQ(collect(), (Numbers{0, 1}));
  EXPECT_EQ(collect(), Numbers{});
}

TEST_F(FrameBufferRecordTest, WithoutARecordThatKeepsFramesNoneIsCollected) {
  FrameBuffer buffer({3}, std::make_unique<DropOldestPolicy>());
  for (Sequence i = 0; i < 5; ++i) capture_and_push(buffer, i);
  buffer.collect_for_record(record_, true);
  buffer.collect_for_record(record_, true);
  EXPECT_TRUE(record_.frames.empty());
}

TEST_F(FrameBufferRecordTest, AFrameThatTheServerMayHaveIsCollectedWhenItTurnsOutNotTo) {
  push(0, 2);
  take(2);
  buffer_.return_in_flight();
  push(3, 4);  // 0 and 1 go
  EXPECT_EQ(collect(), Numbers{});
  buffer_.resume(1);
  EXPECT_EQ(collect(), Numbers{1});
}

TEST_F(FrameBufferRecordTest, OfALongOutageAlsoTheFramesThatTheServerMayHaveAreCollected) {
  push(0, 2);
  take(2);
  buffer_.return_in_flight();
  push(3, 4);  // 0 and 1 go
  collect(true);
  EXPECT_EQ(collect(true), (Numbers{2, 3, 4, 0, 1}));
  buffer_.resume(1);
  EXPECT_EQ(collect(), Numbers{});
  EXPECT_EQ(delivered(), Numbers{0});
}

TEST_F(FrameBufferRecordTest, AtTheEndAllThatIsUndeliveredIsCollected) {
  push(0, 3);
  take(1);
  buffer_.give_up();
  EXPECT_EQ(collect(), (Numbers{0, 1, 2, 3}));
}

TEST_F(FrameBufferRecordTest, GivingUpWaitingFramesCollectsThem) {
  push(0, 2);
  take(1);
  buffer_.give_up_waiting();
  EXPECT_EQ(collect(), (Numbers{1, 2}));
}

TEST_F(FrameBufferRecordTest, ARefusedFrameIsNotCollected) {
  push(0, 1);
  take(1);
  buffer_.refuse_newest();
  EXPECT_EQ(collect(), Numbers{});
}

TEST_F(FrameBufferRecordTest, FramesAreAtRiskOnceTheyWereHereTheTimeBefore) {
  push(0, 1);
  take(1);
  EXPECT_EQ(collect(true), Numbers{});
  push(2, 2);
  EXPECT_EQ(collect(false), Numbers{});
  EXPECT_EQ(collect(true), (Numbers{0, 1}));
  EXPECT_EQ(collect(true), Numbers{2});
  EXPECT_EQ(collect(true), Numbers{});
}

TEST_F(FrameBufferRecordTest, AFrameIsCollectedOnce) {
  push(0, 2);
  collect(true);
  EXPECT_EQ(collect(true), (Numbers{0, 1, 2}));
  push(3, 4);
  EXPECT_EQ(collect(), Numbers{});
  buffer_.give_up();
  EXPECT_EQ(collect(), (Numbers{3, 4}));
}

TEST_F(FrameBufferRecordTest, SaysWhichOfTheCollectedOnesWereAcknowledgedAfterAll) {
  push(0, 2);
  collect(true);
  collect(true);
  take(2);
  buffer_.acknowledge(1);
  collect();
  EXPECT_EQ(delivered(), Numbers{0});
  buffer_.return_in_flight();
  buffer_.resume(2);
  collect();
  EXPECT_EQ(delivered(), Numbers{1});
}

TEST_F(FrameBufferRecordTest, WhatMayStillBeDeliveredBeginsWithTheOldestThatIsHere) {
  constexpr auto kNone = std::numeric_limits<Sequence>::max();
  EXPECT_EQ(first_undelivered(), kNone);
  push(0, 3);
  EXPECT_EQ(first_undelivered(), 1U);
  take(2);
  EXPECT_EQ(first_undelivered(), 1U);
  buffer_.acknowledge(2);
  EXPECT_EQ(first_undelivered(), 2U);
  buffer_.acknowledge(3);
  EXPECT_EQ(first_undelivered(), 3U);
  take(1);
  buffer_.acknowledge(4);
  EXPECT_EQ(first_undelivered(), kNone);
}

TEST_F(FrameBufferRecordTest, ACollectedFrameThatIsRefusedIsOfNoUse) {
  push(0, 0);
  collect(true);
  collect(true);
  take(1);
  buffer_.refuse_newest();
  collect();
  EXPECT_EQ(delivered(), Numbers{0});
}

}  // namespace
}  // namespace orbbuf
