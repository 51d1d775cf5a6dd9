// SPDX-License-Identifier: Apache-2.0
// Once the buffer has seen its worst, it allocates nothing: on a small robot with a full buffer
// every frame would otherwise come with dozens of small pieces for the allocator to keep apart.
#include <gtest/gtest.h>

#include <cstddef>
#include <memory>
#include <utility>
#include <vector>

#include "daemon/buffer/frame_buffer.hpp"
#include "daemon/buffer/orb_policy.hpp"
#include "tests/daemon/buffer/allocations.hpp"
#include "tests/daemon/buffer/frames.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kCapacity = 25;
constexpr Sequence kWarmUp = 1'000;
constexpr Sequence kMeasured = 2'000;

/// Up to 500 features, of which the first is the sequence number.
void fill_features(const EncodedFrame& frame, FeatureSet& features) {
  features.descriptors.reserve(500);
  features.descriptors.assign(static_cast<std::size_t>(500 - frame.sequence % 7),
                              Descriptor{frame.sequence});
}

int fake_similarity(const FeatureSet& a, const FeatureSet& b) {
  return static_cast<int>((a.descriptors[0][0] * 31 + b.descriptors[0][0] * 17) % 101);
}

class SteadyStateTest : public testing::Test {
 protected:
  void push(Sequence sequence) {
    FramePtr frame = make_frame_ptr(sequence);
    const int before = allocations();
    buffer_.on_captured();
    buffer_.push(std::move(frame));
    buffer_allocations_ += allocations() - before;
  }
  /// Runs `link` after each push; what the last kMeasured of them allocated, without the frames.
  template <class Link>
  int allocations_with(Link link) {
    for (Sequence sequence = 0; sequence < kWarmUp + kMeasured; ++sequence) {
      if (sequence == kWarmUp) buffer_allocations_ = 0;
      push(sequence);
      const int before = allocations();
      link(sequence);
      buffer_.collect_drops(drops_);
      buffer_allocations_ += allocations() - before;
    }
    return buffer_allocations_;
  }
  void prepare_all() {
    while (buffer_.prepare()) {
    }
  }

  FrameBuffer buffer_{{kCapacity}, std::make_unique<OrbPolicy>(fill_features, fake_similarity)};
  std::vector<DropRecord> drops_;
  int buffer_allocations_ = 0;
};

TEST_F(SteadyStateTest, AFrameItselfIsTwoAllocations) {
  const int before = allocations();
  const FramePtr frame = make_frame_ptr(1);
  EXPECT_EQ(allocations() - before, 2);
}

TEST_F(SteadyStateTest, ALinkThatKeepsUpAllocatesNothing) {
  EXPECT_EQ(allocations_with([this](Sequence sequence) {
              prepare_all();
              buffer_.take();
              if (sequence >= 3) buffer_.acknowledge(sequence - 3);
            }),
            0);
  EXPECT_EQ(buffer_.stats().dropped, 0U);
}

TEST_F(SteadyStateTest, OverloadWithIdleTimeAllocatesNothing) {
  EXPECT_EQ(allocations_with([this](Sequence sequence) {
              prepare_all();
              if (sequence % 3 == 0) buffer_.take();
              if (sequence > 60) buffer_.acknowledge(sequence - 60);
            }),
            0);
  EXPECT_GT(buffer_.stats().dropped, kMeasured / 2);
}

TEST_F(SteadyStateTest, OverloadWithoutIdleTimeAllocatesNothing) {
  EXPECT_EQ(allocations_with([this](Sequence sequence) {
              if (sequence % 3 == 0) buffer_.take();
              if (sequence > 60) buffer_.acknowledge(sequence - 60);
            }),
            0);
  EXPECT_GT(buffer_.stats().dropped, kMeasured / 2);
}

TEST_F(SteadyStateTest, ALinkThatBreaksAgainAndAgainAllocatesNothing) {
  EXPECT_EQ(allocations_with([this](Sequence sequence) {
              prepare_all();
              const Sequence phase = sequence % 20;
              if (phase == 0) buffer_.return_in_flight();
              if (phase == 1) buffer_.resume(sequence > 40 ? sequence - 40 : 0);
              if (phase > 1 && phase % 2 == 0) buffer_.take();
            }),
            0);
  EXPECT_GT(buffer_.stats().dropped, kMeasured / 4);
}

}  // namespace
}  // namespace orbbuf
