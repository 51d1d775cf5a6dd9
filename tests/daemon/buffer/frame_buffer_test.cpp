// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/frame_buffer.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <memory>
#include <stdexcept>
#include <stop_token>
#include <thread>
#include <utility>
#include <vector>

#include "tests/daemon/buffer/frames.hpp"

namespace orbbuf {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr std::size_t kCapacity = 4;

/// A buffer for four frames; its policy gives up the oldest unless told otherwise.
class FrameBufferTest : public testing::Test {
 protected:
  void push(Sequence first, Sequence last) {
    for (Sequence sequence = first; sequence <= last; ++sequence) {
      capture_and_push(buffer_, sequence);
    }
  }
  void take(int count) {
    while (count-- > 0) ASSERT_TRUE(buffer_.take());
  }
  std::vector<Sequence> take_all() {
    std::vector<Sequence> taken;
    while (const FramePtr frame = buffer_.take()) taken.push_back(frame->sequence);
    return taken;
  }
  std::vector<Sequence> drops() { return sequences_of(collect_drops(buffer_)); }
  bool has_room() {
    std::stop_source stopped;
    stopped.request_stop();
    return buffer_.wait_for_room(stopped.get_token());
  }

  FakePolicy* policy_ = new FakePolicy;  // owned by buffer_
  FrameBuffer buffer_{{kCapacity}, std::unique_ptr<DropPolicy>(policy_)};
};

TEST_F(FrameBufferTest, RefusesACapacityOfLessThanThreeFrames) {
  EXPECT_THROW(FrameBuffer({2}, std::make_unique<FakePolicy>()), std::invalid_argument);
  EXPECT_NO_THROW(FrameBuffer({3}, std::make_unique<FakePolicy>()));
}

TEST_F(FrameBufferTest, WhatIsInFlightIsBoundedInFrames) {
  for (Sequence i = 0; i < FrameBuffer::kMostInFlight; ++i) {
    push(i, i);
    take(1);
  }
  push(100, 101);
  EXPECT_FALSE(buffer_.take());
  EXPECT_EQ(buffer_.stats().waiting, 2U);
  buffer_.acknowledge(1);
  EXPECT_TRUE(buffer_.take());
  EXPECT_FALSE(buffer_.take());
}

TEST_F(FrameBufferTest, WhatIsInFlightHasAtMostHalfOfTheBytesAndCountsInAll) {
  policy_ = new FakePolicy;
  FrameBuffer buffer({100, 8}, std::unique_ptr<DropPolicy>(policy_));  // of frames of one byte
  for (Sequence i = 0; i < 6; ++i) capture_and_push(buffer, i);
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(buffer.take());
  EXPECT_FALSE(buffer.take());
  for (Sequence i = 6; i < 8; ++i) capture_and_push(buffer, i);
  EXPECT_THAT(collect_drops(buffer), IsEmpty());
  capture_and_push(buffer, 8);
  EXPECT_EQ(sequences_of(collect_drops(buffer)), std::vector<Sequence>{4});
  buffer.acknowledge(2);
  EXPECT_TRUE(buffer.take());
}

TEST_F(FrameBufferTest, TwoFramesMayAlwaysBeInFlight) {
  policy_ = new FakePolicy;
  FrameBuffer buffer({100, 1}, std::unique_ptr<DropPolicy>(policy_));
  for (Sequence i = 0; i < 3; ++i) {
    capture_and_push(buffer, i);
    EXPECT_EQ(buffer.take() != nullptr, i < 2) << i;
  }
}

TEST_F(FrameBufferTest, HasRoomUntilItIsFull) {
  for (Sequence count = 0; count <= kCapacity; ++count) {
    EXPECT_EQ(has_room(), count < kCapacity) << count;
    EXPECT_EQ(buffer_.stats().waiting, count);
    push(count, count);
  }
  EXPECT_FALSE(has_room());
  EXPECT_EQ(buffer_.stats().waiting, kCapacity);
}

TEST_F(FrameBufferTest, IfItIsWaitedForNoneIsGivenUpForThoseThatCameBack) {
  FrameBuffer buffer({kCapacity, 100, true}, std::make_unique<FakePolicy>());
  for (Sequence i = 0; i < kCapacity; ++i) capture_and_push(buffer, i);
  ASSERT_TRUE(buffer.take());
  ASSERT_TRUE(buffer.wait_for_room({}));
  buffer.return_in_flight();
  capture_and_push(buffer, kCapacity);
  buffer.resume(0);
  EXPECT_THAT(collect_drops(buffer), IsEmpty());
  EXPECT_EQ(buffer.stats().waiting, kCapacity + 1);
}

TEST_F(FrameBufferTest, HandsOutWhatWaitsInOrderAndThenNothing) {
  Sequence next = 0;
  for (const std::size_t count : {0U, 1U, 3U, 4U}) {
    std::vector<Sequence> pushed;
    for (std::size_t i = 0; i < count; ++i) pushed.push_back(next++);
    for (const Sequence sequence : pushed) push(sequence, sequence);
    EXPECT_EQ(take_all(), pushed);
    EXPECT_EQ(buffer_.stats().in_flight, count);
    buffer_.acknowledge(next);
    EXPECT_EQ(buffer_.stats().in_flight, 0U);
  }
}

TEST_F(FrameBufferTest, AFullPushGivesUpTheFrameThatThePolicyNames) {
  policy_->on_victim = [](const BufferView&) { return 2; };
  push(0, 4);
  EXPECT_EQ(collect_drops(buffer_),
            (std::vector<DropRecord>{{2, 20'000'000, DropReason::kPolicy}}));
  EXPECT_THAT(collect_drops(buffer_), IsEmpty());
  EXPECT_THAT(take_all(), ElementsAre(0, 1, 3, 4));
}

TEST_F(FrameBufferTest, ReturnedFramesComeFirstAgainAndInOrder) {
  push(0, 3);
  take(3);
  buffer_.acknowledge(1);
  buffer_.return_in_flight();
  buffer_.resume(1);
  EXPECT_THAT(take_all(), ElementsAre(1, 2, 3));
}

TEST_F(FrameBufferTest, ReturnedFramesMayExceedCapacityUntilTheNextPush) {
  push(0, 3);
  take(3);
  push(4, 6);
  buffer_.return_in_flight();
  EXPECT_EQ(buffer_.stats().waiting, 7U);
  EXPECT_THAT(drops(), IsEmpty());
  push(7, 7);
  EXPECT_EQ(buffer_.stats().waiting, kCapacity);
  EXPECT_EQ(buffer_.stats().dropped, 4U);
  EXPECT_THAT(drops(), ElementsAre(3));  // 0, 1 and 2 may have arrived
}

TEST_F(FrameBufferTest, ResumeCountsWhatTheServerHasAndForgetsThatTheRestWasTaken) {
  push(0, 3);
  take(3);
  buffer_.return_in_flight();
  buffer_.resume(2);
  EXPECT_EQ(buffer_.stats().acknowledged, 2U);
  push(4, 6);
  EXPECT_THAT(drops(), ElementsAre(2));  // not with the server, as is known now
  EXPECT_THAT(take_all(), ElementsAre(3, 4, 5, 6));
}

TEST_F(FrameBufferTest, ADropThatTurnsOutDeliveredIsNeverReported) {
  push(0, 3);
  take(2);
  buffer_.return_in_flight();
  push(4, 5);
  EXPECT_EQ(buffer_.stats().dropped, 2U);
  EXPECT_THAT(drops(), IsEmpty());
  buffer_.resume(1);
  EXPECT_EQ(buffer_.stats().dropped, 1U);
  EXPECT_THAT(drops(), ElementsAre(1));
  EXPECT_THAT(take_all(), ElementsAre(2, 3, 4, 5));
}

TEST_F(FrameBufferTest, AConnectionThatDiesBeforeItSpeaksSettlesNothing) {
  push(0, 3);
  take(2);
  buffer_.return_in_flight();
  push(4, 4);
  buffer_.return_in_flight();
  EXPECT_THAT(drops(), IsEmpty());
  buffer_.resume(2);
  EXPECT_THAT(drops(), IsEmpty());
  EXPECT_EQ(buffer_.stats().acknowledged, 2U);
}

TEST_F(FrameBufferTest, CountsLostFramesByTheirReason) {
  for (int i = 0; i < 4; ++i) buffer_.on_captured();
  EXPECT_EQ(buffer_.stats().waiting, 4U);
  buffer_.on_lost({0, 0, DropReason::kBusy});
  buffer_.on_lost({1, 0, DropReason::kFailed});
  buffer_.on_lost({2, 0, DropReason::kShutdown});
  buffer_.push(make_frame_ptr(3));
  const wire::Stats expected{
      .captured = 4, .skipped = 1, .failed = 1, .dropped = 1, .acknowledged = 0, .waiting = 1};
  EXPECT_EQ(buffer_.stats(), expected);
  EXPECT_THAT(drops(), ElementsAre(0, 1, 2));
}

TEST_F(FrameBufferTest, ReportsItsCapacityAndWhatWaits) {
  EXPECT_EQ(buffer_.report(), (wire::Report{{}, kCapacity}));
  push(0, 2);
  take(1);
  const wire::Report report = buffer_.report();
  EXPECT_EQ(report.stats, buffer_.stats());
  EXPECT_EQ(report.waiting_bytes, 2 * make_frame_ptr(0)->jpeg.size());
  EXPECT_GT(report.waiting_bytes, 0U);
}

TEST_F(FrameBufferTest, ARefusedFrameIsADropOfItsOwnKind) {
  push(0, 2);
  take(2);
  buffer_.refuse_newest();
  EXPECT_EQ(collect_drops(buffer_),
            (std::vector{DropRecord{1, make_frame_ptr(1)->capture_time_ns, DropReason::kRefused}}));
  buffer_.acknowledge(1);
  EXPECT_EQ(buffer_.stats(),
            (wire::Stats{.captured = 3, .dropped = 1, .acknowledged = 1, .waiting = 1}));
}

TEST_F(FrameBufferTest, GivingUpNamesEveryUndeliveredFrame) {
  push(0, 3);
  take(2);
  buffer_.return_in_flight();
  push(4, 4);
  take(1);
  buffer_.give_up();
  const std::vector<DropRecord> records = collect_drops(buffer_);
  EXPECT_THAT(sequences_of(records), ElementsAre(0, 1, 2, 3, 4));
  EXPECT_EQ(records[0].reason, DropReason::kPolicy);
  EXPECT_EQ(records[1].reason, DropReason::kUnknown);  // the server may have it
  for (std::size_t i = 2; i < records.size(); ++i) {
    EXPECT_EQ(records[i].reason, DropReason::kShutdown);
  }
  EXPECT_EQ(buffer_.stats(), (wire::Stats{.captured = 5, .dropped = 5}));
}

TEST_F(FrameBufferTest, AFrameTakenWhileThePolicyThinksCostsNoDrop) {
  policy_->on_victim = [&](const BufferView&) {
    take(1);
    return 2;
  };
  push(0, 4);
  EXPECT_THAT(drops(), IsEmpty());
  EXPECT_THAT(take_all(), ElementsAre(1, 2, 3, 4));
}

TEST_F(FrameBufferTest, ADeliveryLearntWhileThePolicyThinksCostsNoDrop) {
  push(0, 3);
  take(2);
  buffer_.return_in_flight();
  policy_->on_victim = [&](const BufferView&) {
    buffer_.resume(2);
    return 0;
  };
  push(4, 4);
  EXPECT_THAT(drops(), IsEmpty());
  EXPECT_THAT(take_all(), ElementsAre(2, 3, 4));
}

TEST_F(FrameBufferTest, AVictimThatIsOnItsWayIsReplacedByAnother) {
  push(0, 3);
  take(3);
  push(4, 6);
  buffer_.return_in_flight();
  bool is_first = true;
  policy_->on_victim = [&](const BufferView& view) -> std::size_t {
    if (!std::exchange(is_first, false)) return view.waiting.size() - 2;
    buffer_.resume(0);
    take(1);
    return 0;
  };
  push(7, 7);
  EXPECT_THAT(drops(), ElementsAre(6, 5, 4));
  EXPECT_THAT(take_all(), ElementsAre(1, 2, 3, 7));
}

/// Whatever makes room wakes who waits for it.
class WaitForRoomTest : public FrameBufferTest {
 protected:
  template <class Action>
  bool is_woken_by(Action action) {
    bool has_room = false;
    std::jthread waiter(
        [&](const std::stop_token& stop) { has_room = buffer_.wait_for_room(stop); });
    // Most likely it waits then. If not, the test proves less and still passes.
    for (int i = 0; i < 1'000; ++i) std::this_thread::yield();
    action(waiter);
    waiter.join();
    return has_room;
  }
};

TEST_F(WaitForRoomTest, TakingAFrameWakes) {
  push(0, 3);
  EXPECT_TRUE(is_woken_by([&](std::jthread&) { take(1); }));
}

TEST_F(WaitForRoomTest, LearningThatFramesArrivedWakes) {
  push(0, 3);
  take(2);
  buffer_.return_in_flight();
  EXPECT_TRUE(is_woken_by([&](std::jthread&) { buffer_.resume(1); }));
}

TEST_F(WaitForRoomTest, GivingUpWakes) {
  push(0, 3);
  EXPECT_TRUE(is_woken_by([&](std::jthread&) { buffer_.give_up(); }));
}

TEST_F(WaitForRoomTest, StoppingWakesWithoutRoom) {
  push(0, 3);
  EXPECT_FALSE(is_woken_by([](std::jthread& waiter) { waiter.request_stop(); }));
}

}  // namespace
}  // namespace orbbuf
