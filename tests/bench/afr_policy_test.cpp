// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/afr_policy.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <memory>
#include <vector>

namespace orbbuf::sim {
namespace {

using testing::ElementsAre;

/// A buffer of six frames under the policy.
class AfrPolicyTest : public testing::Test {
 protected:
  void arrive(std::size_t count) {
    for (; count > 0; --count) {
      const bool is_admitted = policy_.admits(view_.waiting.size());
      EncodedFrame frame;
      frame.sequence = next_++;
      if (!is_admitted) continue;
      view_.waiting.push_back(std::make_shared<const EncodedFrame>(std::move(frame)));
      if (view_.waiting.size() <= 6) continue;
      const std::size_t victim = policy_.victim(view_);
      ASSERT_LT(victim + 1, view_.waiting.size());
      view_.waiting.erase(view_.waiting.begin() + static_cast<std::ptrdiff_t>(victim));
    }
  }

  void send(std::size_t count) {
    view_.waiting.erase(view_.waiting.begin(),
                        view_.waiting.begin() + static_cast<std::ptrdiff_t>(count));
  }

  std::vector<Sequence> waiting() const {
    std::vector<Sequence> numbers;
    for (const FramePtr& frame : view_.waiting) numbers.push_back(frame->sequence);
    return numbers;
  }

 private:
  AfrPolicy policy_{6};
  BufferView view_;
  Sequence next_ = 0;
};

TEST_F(AfrPolicyTest, KeepsAllWhileThereIsRoom) {
  arrive(6);
  EXPECT_THAT(waiting(), ElementsAre(0, 1, 2, 3, 4, 5));
}

TEST_F(AfrPolicyTest, DeletesEveryOtherFrameInASweepFromTheOldest) {
  arrive(9);
  EXPECT_THAT(waiting(), ElementsAre(1, 3, 5, 6, 7, 8));
  arrive(3);
  EXPECT_THAT(waiting(), ElementsAre(1, 3, 5, 7, 9, 11));
}

TEST_F(AfrPolicyTest, TheNextSweepLetsInEveryOtherArrival) {
  arrive(12);  // a sweep
  arrive(6);
  EXPECT_THAT(waiting(), ElementsAre(3, 7, 11, 13, 15, 17));
  arrive(6);
  EXPECT_THAT(waiting(), ElementsAre(3, 7, 11, 15, 19, 23));
  arrive(4);  // and the one after that, every fourth
  EXPECT_THAT(waiting(), ElementsAre(7, 11, 15, 19, 23, 27));
}

TEST_F(AfrPolicyTest, TheLevelHalvesWhereTheBufferIsTwoThirdsFull) {
  arrive(12);
  send(1);
  arrive(2);  // five wait, more than two thirds: still every other one
  EXPECT_THAT(waiting(), ElementsAre(3, 5, 7, 9, 11, 13));
  send(2);
  arrive(2);
  EXPECT_THAT(waiting(), ElementsAre(7, 9, 11, 13, 14, 15));
}

TEST_F(AfrPolicyTest, ASendMovesTheDeletePositionBack) {
  arrive(9);  // three deleted; the next is behind 1, 3 and 5
  send(2);
  arrive(2);
  EXPECT_THAT(waiting(), ElementsAre(5, 6, 7, 8, 9, 10));
  arrive(1);  // only 5 is left of those three
  EXPECT_THAT(waiting(), ElementsAre(5, 7, 8, 9, 10, 11));
}

}  // namespace
}  // namespace orbbuf::sim
