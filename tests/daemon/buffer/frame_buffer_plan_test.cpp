// SPDX-License-Identifier: Apache-2.0
// FrameBuffer with a SendPlanner: what is passed over, and a store bounded by bytes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <optional>
#include <stop_token>
#include <utility>
#include <vector>

#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/buffer/make_policy.hpp"
#include "daemon/buffer/simple_policies.hpp"
#include "tests/daemon/buffer/frames.hpp"

namespace orbbuf {
namespace {

using std::chrono::milliseconds;
using testing::ElementsAre;
using testing::IsEmpty;

constexpr std::size_t kFrameBytes = 100;
constexpr double kNeed = kFrameBytes / 0.01;  // a frame every 10 ms

/// Holds 40 frames. To be live again within 100 ms, by steps of up to 200 ms.
class FrameBufferPlanTest : public testing::Test {
 protected:
  static BufferSettings settings() {
    BufferSettings settings;
    settings.memory_bytes = 40 * kFrameBytes;
    settings.plan = {milliseconds(100), milliseconds(200)};
    return settings;
  }
  void push(Sequence first, Sequence last) {
    for (Sequence sequence = first; sequence <= last; ++sequence) {
      EncodedFrame frame = make_frame(sequence);
      frame.jpeg.resize(kFrameBytes);
      buffer_.on_captured();
      buffer_.push(std::make_shared<const EncodedFrame>(std::move(frame)));
    }
  }
  /// The link has just taken a frame, at twice the need.
  Sequence take(int after_ms) {
    now_ += milliseconds(after_ms);
    const FramePtr frame = buffer_.take({now_, 2 * kNeed});
    EXPECT_TRUE(frame);
    return frame ? frame->sequence : 0;
  }
  std::vector<Sequence> drops() { return sequences_of(collect_drops(buffer_)); }
  std::vector<Sequence> take_all() {
    std::vector<Sequence> taken;
    while (buffer_.stats().waiting > 0) taken.push_back(take(5));
    return taken;
  }

  FrameBuffer buffer_ = make_buffer(settings(), random_features);
  std::chrono::nanoseconds now_{0};
};

TEST_F(FrameBufferPlanTest, WhatIsPassedOverIsNamedAndSettledAtOnce) {
  push(0, 0);
  EXPECT_EQ(take(0), 0U);
  push(1, 30);
  const Sequence next = take(300);
  EXPECT_GT(next, 1U);
  EXPECT_EQ(drops().size(), next - 1);
  const wire::Stats stats = buffer_.stats();
  EXPECT_EQ(stats.dropped, next - 1);
  EXPECT_EQ(stats.captured, stats.dropped + stats.waiting + stats.in_flight);
}

TEST_F(FrameBufferPlanTest, TheStepsFromTheLastFrameSentToTheNewestAreEven) {
  push(0, 0);
  take(0);
  push(1, 36);
  std::vector<Sequence> taken = {take(360)};
  for (Sequence newest = 37; newest < 80; ++newest) {
    push(newest, newest);
    buffer_.acknowledge(taken.back());
    for (int send = 0; send < 2 && buffer_.stats().waiting > 0; ++send) taken.push_back(take(5));
  }
  EXPECT_EQ(taken.back(), 79U);
  EXPECT_LE(taken.front(), 4U);
  for (std::size_t k = 1; k < taken.size(); ++k) EXPECT_LE(taken[k] - taken[k - 1], 4U) << k;
}

TEST_F(FrameBufferPlanTest, AFrameThatReturnsIsPlannedOverLikeAnyOther) {
  push(0, 0);
  take(0);
  push(1, 2);
  EXPECT_EQ(take(10), 1U);
  buffer_.acknowledge(1);
  buffer_.return_in_flight();
  push(3, 40);
  buffer_.resume(1);  // the server never got frame 1
  const Sequence next = take(400);
  EXPECT_GT(next, 1U);
  EXPECT_EQ(drops().front(), 1U);
  EXPECT_EQ(buffer_.stats().dropped, next - 1);
}

TEST_F(FrameBufferPlanTest, AFullStoreIsThinnedEvenly) {
  push(0, 0);
  take(0);
  buffer_.acknowledge(1);
  push(1, 160);
  EXPECT_EQ(buffer_.stats().waiting, 40U);
  const std::vector<Sequence> given_up = drops();
  std::vector<bool> is_kept(161, true);
  for (const Sequence sequence : given_up) is_kept[static_cast<std::size_t>(sequence)] = false;
  int missing = 0;
  for (Sequence sequence = 1; sequence <= 160; ++sequence) {
    missing = is_kept[static_cast<std::size_t>(sequence)] ? 0 : missing + 1;
    EXPECT_LE(missing, 7) << sequence;  // evenly it is 3; who thins online is within twice that
  }
  EXPECT_TRUE(is_kept[160]);
}

TEST_F(FrameBufferPlanTest, TheNewestIsKeptHoweverLargeItIs) {
  EncodedFrame large = make_frame(0);
  large.jpeg.resize(100 * kFrameBytes);
  buffer_.on_captured();
  buffer_.push(std::make_shared<const EncodedFrame>(std::move(large)));
  EXPECT_EQ(buffer_.stats().waiting, 1U);
  push(1, 1);
  EXPECT_THAT(drops(), ElementsAre(0));
}

TEST_F(FrameBufferPlanTest, ItsCapacityIsReportedInFramesOfTheMeanSize) {
  push(0, 3);
  EXPECT_EQ(buffer_.report().capacity, 40U);
  EXPECT_EQ(buffer_.report().waiting_bytes, 4 * kFrameBytes);
}

TEST_F(FrameBufferPlanTest, WhatWaitsIsCountedInBytesThroughEveryWayOut) {
  push(0, 5);
  take(0);
  EXPECT_EQ(buffer_.report().waiting_bytes, 5 * kFrameBytes);
  buffer_.return_in_flight();
  EXPECT_EQ(buffer_.report().waiting_bytes, 6 * kFrameBytes);
  buffer_.resume(1);
  EXPECT_EQ(buffer_.report().waiting_bytes, 5 * kFrameBytes);
  take(5);
  buffer_.return_in_flight();
  buffer_.give_up_waiting();
  EXPECT_EQ(buffer_.report().waiting_bytes, kFrameBytes);
  buffer_.give_up();
  EXPECT_EQ(buffer_.report().waiting_bytes, 0U);
}

/// The same buffer with a range of qualities, and a reducer that the test plays.
class FrameBufferReduceTest : public testing::Test {
 protected:
  FrameBufferReduceTest() {
    stopped_.request_stop();
    buffer_.expect_reductions();
  }
  void push(Sequence first, Sequence last) {
    for (Sequence sequence = first; sequence <= last; ++sequence) {
      buffer_.on_captured();
      buffer_.push(make(sequence, 80, kFrameBytes));
    }
  }
  static FramePtr make(Sequence sequence, int quality, std::size_t bytes) {
    EncodedFrame frame = make_frame(sequence);
    frame.quality = static_cast<std::uint8_t>(quality);
    frame.jpeg.resize(bytes);
    return std::make_shared<const EncodedFrame>(std::move(frame));
  }
  FramePtr take(int after_ms, bool is_busy) {
    now_ += milliseconds(after_ms);
    SendMoment moment{now_, 2 * kNeed};
    moment.is_busy = is_busy;
    return buffer_.take(moment);
  }
  std::optional<Reductions::Job> job() { return buffer_.next_to_reduce(stopped_.get_token()); }
  /// Frame 0 has been sent, and 1 to 20 wait since an outage.
  void outage() {
    push(0, 0);
    take(0, false);
    push(1, 20);
  }

  FrameBuffer buffer_{
      {.bytes = 100 * kFrameBytes},
      std::make_unique<UniformPolicy>(),
      std::make_unique<SendPlanner>(PlanSettings{milliseconds(100), milliseconds(200), 80, 20})};
  std::stop_source stopped_;
  std::chrono::nanoseconds now_{0};
};

TEST_F(FrameBufferReduceTest, WhatWillBeTakenIsMadeSmallerBeforeAndThenTaken) {
  outage();
  buffer_.look_ahead({milliseconds(200), 2 * kNeed});
  const auto first = job();
  ASSERT_TRUE(first);
  EXPECT_EQ(first->whole->sequence, 1U);
  EXPECT_LT(first->quality, 80);
  const FramePtr reduced = make(1, first->quality, 30);
  buffer_.on_reduced(*first, reduced);
  EXPECT_EQ(take(200, false), reduced);
  EXPECT_EQ(buffer_.stats().in_flight, 1U + 1U);
}

TEST_F(FrameBufferReduceTest, TheLinkDoesNotWaitForTheReducer) {
  outage();
  const FramePtr frame = take(200, false);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->quality, 80);
}

TEST_F(FrameBufferReduceTest, ASlowLinkWaitsForTheReducerSinceAWholeFrameTakesLonger) {
  outage();
  const SendMoment slow{milliseconds(200), kNeed / 4};
  EXPECT_FALSE(buffer_.take(slow));
  const auto first = job();
  ASSERT_TRUE(first);
  const FramePtr reduced = make(first->whole->sequence, first->quality, 30);
  buffer_.on_reduced(*first, reduced);
  EXPECT_EQ(buffer_.take(slow), reduced);
}

TEST_F(FrameBufferReduceTest, ABusyLinkWaitsForTheReducerAndNothingIsLostByIt) {
  outage();
  EXPECT_FALSE(take(200, true));
  EXPECT_EQ(buffer_.stats().waiting, 20U);
  EXPECT_THAT(collect_drops(buffer_), IsEmpty());
  const auto first = job();
  ASSERT_TRUE(first);
  const FramePtr reduced = make(first->whole->sequence, first->quality, 30);
  buffer_.on_reduced(*first, reduced);
  EXPECT_EQ(take(1, true), reduced);
}

TEST_F(FrameBufferReduceTest, AFrameThatCannotBeMadeSmallerGoesAsItIsAndIsCounted) {
  outage();
  EXPECT_FALSE(take(200, true));
  const auto first = job();
  buffer_.on_reduced(*first, nullptr);
  const FramePtr frame = take(1, true);
  EXPECT_EQ(frame, first->whole);
  EXPECT_EQ(buffer_.report().irreducible, 1U);
}

TEST_F(FrameBufferReduceTest, AReducedFrameThatReturnsIsWholeAgain) {
  outage();
  EXPECT_FALSE(take(200, true));
  const auto first = job();
  buffer_.on_reduced(*first, make(first->whole->sequence, first->quality, 30));
  ASSERT_TRUE(take(1, true));
  buffer_.acknowledge(1);
  const auto before = buffer_.report().waiting_bytes;
  buffer_.return_in_flight();
  EXPECT_EQ(buffer_.report().waiting_bytes, before + kFrameBytes);
  buffer_.resume(1);
  EXPECT_EQ(take(1, false)->sequence, first->whole->sequence);
}

TEST_F(FrameBufferReduceTest, NothingIsMadeSmallerWhileTheLinkKeepsUp) {
  for (Sequence sequence = 0; sequence < 100; ++sequence) {
    push(sequence, sequence);
    buffer_.look_ahead({now_, 2 * kNeed});
    EXPECT_FALSE(job()) << sequence;
    EXPECT_EQ(take(10, false)->quality, 80);
    buffer_.acknowledge(sequence + 1);
  }
}

TEST_F(FrameBufferReduceTest, ALookAheadGivesUpNothing) {
  outage();
  for (int i = 0; i < 10; ++i) buffer_.look_ahead({milliseconds(200 + i), 2 * kNeed});
  EXPECT_EQ(buffer_.stats().waiting, 20U);
  EXPECT_THAT(collect_drops(buffer_), IsEmpty());
}

TEST_F(FrameBufferPlanTest, NothingIsPassedOverWhileTheLinkKeepsUp) {
  for (Sequence sequence = 0; sequence < 200; ++sequence) {
    push(sequence, sequence);
    EXPECT_EQ(take(10), sequence);
    buffer_.acknowledge(sequence + 1);
  }
  EXPECT_THAT(drops(), IsEmpty());
}

}  // namespace
}  // namespace orbbuf
