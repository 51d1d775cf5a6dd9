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

/// A buffer for three frames, which gives up the oldest, with a spool.
class FrameBufferSpoolTest : public testing::Test {
 protected:
  FrameBufferSpoolTest() { buffer_.keep_for_spool(); }
  void push(Sequence first, Sequence last) {
    for (Sequence i = first; i <= last; ++i) capture_and_push(buffer_, i);
  }
  void take(int count) {
    while (count-- > 0) ASSERT_TRUE(buffer_.take());
  }
  Numbers collect(bool those_at_risk = false) {
    buffer_.collect_for_spool(spool_, those_at_risk);
    Numbers numbers;
    for (const FramePtr& frame : spool_.frames) numbers.push_back(frame->sequence);
    return numbers;
  }
  const Numbers& acknowledged() const { return spool_.acknowledged; }

  FrameBuffer buffer_{{3}, std::make_unique<DropOldestPolicy>()};
  FrameBuffer::ForSpool spool_;
};

TEST_F(FrameBufferSpoolTest, CollectsWhatThePolicyDropsAndNothingElse) {
  EXPECT_EQ(collect(), Numbers{});
  push(0, 2);
  EXPECT_EQ(collect(), Numbers{});
  push(3, 4);
  EXPECT_EQ(collect(), (Numbers{0, 1}));
  EXPECT_EQ(collect(), Numbers{});
}

TEST_F(FrameBufferSpoolTest, WithoutASpoolNothingIsKept) {
  FrameBuffer buffer({3}, std::make_unique<DropOldestPolicy>());
  for (Sequence i = 0; i < 5; ++i) capture_and_push(buffer, i);
  buffer.collect_for_spool(spool_, true);
  buffer.collect_for_spool(spool_, true);
  EXPECT_TRUE(spool_.frames.empty());
}

TEST_F(FrameBufferSpoolTest, AFrameThatTheServerMayHaveIsCollectedWhenItTurnsOutNotTo) {
  push(0, 2);
  take(2);
  buffer_.return_in_flight();
  push(3, 4);  // 0 and 1 go
  EXPECT_EQ(collect(), Numbers{});
  buffer_.resume(1);
  EXPECT_EQ(collect(), Numbers{1});
}

TEST_F(FrameBufferSpoolTest, AtTheEndAllThatIsUndeliveredIsCollected) {
  push(0, 3);
  take(1);
  buffer_.give_up();
  EXPECT_EQ(collect(), (Numbers{0, 1, 2, 3}));
}

TEST_F(FrameBufferSpoolTest, GivingUpWaitingFramesCollectsThem) {
  push(0, 2);
  take(1);
  buffer_.give_up_waiting();
  EXPECT_EQ(collect(), (Numbers{1, 2}));
}

TEST_F(FrameBufferSpoolTest, ARefusedFrameIsNotCollected) {
  push(0, 1);
  take(1);
  buffer_.refuse_newest();
  EXPECT_EQ(collect(), Numbers{});
}

TEST_F(FrameBufferSpoolTest, FramesAreAtRiskOnceTheyWereHereTheTimeBefore) {
  push(0, 1);
  take(1);
  EXPECT_EQ(collect(true), Numbers{});
  push(2, 2);
  EXPECT_EQ(collect(false), Numbers{});
  EXPECT_EQ(collect(true), (Numbers{0, 1}));
  EXPECT_EQ(collect(true), Numbers{2});
  EXPECT_EQ(collect(true), Numbers{});
}

TEST_F(FrameBufferSpoolTest, AFrameIsCollectedOnce) {
  push(0, 2);
  collect(true);
  EXPECT_EQ(collect(true), (Numbers{0, 1, 2}));
  push(3, 4);
  EXPECT_EQ(collect(), Numbers{});
  buffer_.give_up();
  EXPECT_EQ(collect(), (Numbers{3, 4}));
}

TEST_F(FrameBufferSpoolTest, SaysWhichOfTheCollectedOnesWereAcknowledgedAfterAll) {
  push(0, 2);
  collect(true);
  collect(true);
  take(2);
  buffer_.acknowledge(1);
  collect();
  EXPECT_EQ(acknowledged(), Numbers{0});
  buffer_.return_in_flight();
  buffer_.resume(2);
  collect();
  EXPECT_EQ(acknowledged(), Numbers{1});
}

TEST_F(FrameBufferSpoolTest, WhatMayStillBeDeliveredBeginsWithTheOldestThatIsHere) {
  constexpr auto kNone = std::numeric_limits<Sequence>::max();
  EXPECT_EQ(buffer_.first_undelivered(), kNone);
  push(0, 3);
  EXPECT_EQ(buffer_.first_undelivered(), 1U);
  take(2);
  EXPECT_EQ(buffer_.first_undelivered(), 1U);
  buffer_.acknowledge(2);
  EXPECT_EQ(buffer_.first_undelivered(), 2U);
  buffer_.acknowledge(3);
  EXPECT_EQ(buffer_.first_undelivered(), 3U);
  take(1);
  buffer_.acknowledge(4);
  EXPECT_EQ(buffer_.first_undelivered(), kNone);
}

TEST_F(FrameBufferSpoolTest, ACollectedFrameThatIsRefusedIsOfNoUse) {
  push(0, 0);
  collect(true);
  collect(true);
  take(1);
  buffer_.refuse_newest();
  collect();
  EXPECT_EQ(acknowledged(), Numbers{0});
}

}  // namespace
}  // namespace orbbuf
