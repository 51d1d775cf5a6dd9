// SPDX-License-Identifier: Apache-2.0
// What FrameBuffer asks its policy, and when.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "daemon/buffer/frame_buffer.hpp"
#include "tests/daemon/buffer/frames.hpp"

namespace orbbuf {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

/// A buffer for four frames, and what its policy was last asked to prepare for.
class FrameBufferPrepareTest : public testing::Test {
 protected:
  void SetUp() override {
    policy_->on_prepare = [this](const BufferView& view) {
      seen_.push_back(sequences_of(view.waiting));
      previous_ = view.previous;
      return more_;
    };
  }
  void push(Sequence first, Sequence last) {
    for (Sequence sequence = first; sequence <= last; ++sequence) {
      capture_and_push(buffer_, sequence);
    }
  }
  void take(int count) {
    while (count-- > 0) ASSERT_TRUE(buffer_.take());
  }

  FakePolicy* policy_ = new FakePolicy;  // owned by buffer_
  FrameBuffer buffer_{{4}, std::unique_ptr<DropPolicy>(policy_)};
  std::vector<std::vector<Sequence>> seen_;
  FramePtr previous_;
  bool more_ = false;
};

TEST_F(FrameBufferPrepareTest, AsksThePolicyNothingWhileTheLinkKeepsUp) {
  more_ = true;
  EXPECT_FALSE(buffer_.prepare());
  for (Sequence sequence = 0; sequence < 10; ++sequence) {
    push(sequence, sequence);
    EXPECT_FALSE(buffer_.prepare());
    take(1);
    EXPECT_FALSE(buffer_.prepare());
  }
  EXPECT_THAT(seen_, IsEmpty());
}

TEST_F(FrameBufferPrepareTest, APushThatCostsNoFrameAsksThePolicyNothing) {
  policy_->on_victim = [](const BufferView&) {
    ADD_FAILURE() << "nothing has to go";
    return 0;
  };
  push(0, 3);
  EXPECT_THAT(seen_, IsEmpty());
}

TEST_F(FrameBufferPrepareTest, ShowsThePolicyWhatWaitsAsSoonAsAFrameWaitsBehindAnother) {
  push(0, 1);
  buffer_.prepare();
  push(2, 3);
  buffer_.prepare();
  push(4, 4);
  buffer_.prepare();
  EXPECT_THAT(seen_, ElementsAre(ElementsAre(0, 1), ElementsAre(0, 1, 2, 3),  //
                                 ElementsAre(1, 2, 3, 4)));
}

TEST_F(FrameBufferPrepareTest, SaysWhetherThePolicyHasMoreToDo) {
  push(0, 1);
  more_ = true;
  EXPECT_TRUE(buffer_.prepare());
  more_ = false;
  EXPECT_FALSE(buffer_.prepare());
}

TEST_F(FrameBufferPrepareTest, TheNetworkGoesOnWhileThePolicyPrepares) {
  policy_->on_prepare = [this](const BufferView& view) {
    take(2);
    EXPECT_THAT(sequences_of(view.waiting), ElementsAre(0, 1));
    return true;
  };
  push(0, 1);
  EXPECT_TRUE(buffer_.prepare());
  EXPECT_FALSE(buffer_.prepare());
}

TEST_F(FrameBufferPrepareTest, KeepsNoFrameAliveForWhatThePolicyHasSeen) {
  policy_->on_prepare = [](const BufferView&) { return false; };
  std::vector<std::weak_ptr<const EncodedFrame>> frames;
  for (Sequence sequence = 0; sequence < 6; ++sequence) {
    FramePtr frame = make_frame_ptr(sequence);
    frames.emplace_back(frame);
    buffer_.on_captured();
    buffer_.push(std::move(frame));
  }
  EXPECT_TRUE(frames[0].expired());
  EXPECT_TRUE(frames[1].expired());  // the last victim
  buffer_.prepare();
  take(4);
  buffer_.acknowledge(6);
  for (std::size_t i = 2; i < 5; ++i) EXPECT_TRUE(frames[i].expired()) << i;
  EXPECT_FALSE(frames[5].expired());  // the next head's neighbour
}

TEST_F(FrameBufferPrepareTest, TheHeadIsJudgedAgainstTheFrameLastHandedToTheNetwork) {
  push(0, 1);
  buffer_.prepare();
  EXPECT_FALSE(previous_);
  take(2);
  push(2, 3);
  buffer_.prepare();
  EXPECT_EQ(previous_->sequence, 1U);
  buffer_.acknowledge(1);
  buffer_.prepare();
  EXPECT_EQ(previous_->sequence, 1U);  // still in flight
  buffer_.acknowledge(2);
  take(1);
  buffer_.return_in_flight();
  buffer_.prepare();
  EXPECT_EQ(previous_->sequence, 1U);  // acknowledged; 2 waits again
}

TEST_F(FrameBufferPrepareTest, ADropThatTurnsOutDeliveredIsTheHeadsNeighbour) {
  policy_->on_victim = [](const BufferView&) { return 1; };
  push(0, 3);
  take(2);
  buffer_.return_in_flight();
  push(4, 4);
  buffer_.resume(2);
  buffer_.prepare();
  EXPECT_EQ(previous_->sequence, 1U);
}

}  // namespace
}  // namespace orbbuf
