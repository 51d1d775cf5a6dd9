// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/orb_policy.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "tests/daemon/buffer/orb_policy_fixture.hpp"

namespace orbbuf {
namespace {

using testing::ElementsAre;

constexpr std::size_t kCapacity = 8;

TEST_F(OrbPolicyTest, NamesTheFrameWhoseNeighboursAreMostAlike) {
  table_ = [](Sequence a, Sequence b) { return a == 2 && b == 4 ? 50 : 10; };
  const BufferView view{make_frame_ptr(0),
                        {make_frame_ptr(1), make_frame_ptr(2), make_frame_ptr(3), make_frame_ptr(4),
                         make_frame_ptr(5)}};
  const auto policy = make();
  EXPECT_THAT(policy->scores(view), ElementsAre(10, 10, 50, 10));
  EXPECT_EQ(policy->victim(view), 2U);
}

TEST_F(OrbPolicyTest, SaysHowAlikeTheVictimLeavesItsNeighbours) {
  table_ = [](Sequence a, Sequence b) { return a == 2 && b == 4 ? 50 : 10; };
  BufferView view = view_of({0U, 1U, 2U, 3U, 4U, 5U});
  const auto policy = make();
  EXPECT_EQ(policy->last_score(), std::nullopt);
  policy->scores(view);
  policy->victim(view);
  EXPECT_EQ(policy->last_score(), 50);
  view.previous = nullptr;
  policy->victim(view);
  EXPECT_EQ(policy->last_score(), std::nullopt);
}

TEST_F(OrbPolicyTest, NamesAHeadWithNothingBeforeItWithoutLookingAtIt) {
  BufferView view{nullptr, {make_frame_ptr(0), make_frame_ptr(1)}};
  const auto policy = make();
  EXPECT_EQ(policy->victim(view), 0U);
  EXPECT_TRUE(extractions_.empty());
  table_ = [](Sequence, Sequence) { return 500; };
  view.waiting.push_back(make_frame_ptr(2));
  EXPECT_THAT(policy->scores(view), ElementsAre(OrbPolicy::kFreeToGo, 500));
  EXPECT_EQ(policy->victim(view), 0U);
}

TEST_F(OrbPolicyTest, OfEqualScoresTheSmallerGapInTimeGoesFirstAndThenTheOlder) {
  table_ = [](Sequence, Sequence) { return 7; };
  const auto policy = make();
  BufferView view = view_of({4U, 6U, 7U, 8U, 9U});
  policy->scores(view);
  EXPECT_EQ(policy->victim(view), 2U);
  view.waiting.erase(view.waiting.begin() + 2);
  EXPECT_EQ(policy->victim(view), 2U);
  view.waiting.erase(view.waiting.begin() + 2);
  EXPECT_EQ(policy->victim(view), 1U);
}

TEST_F(OrbPolicyTest, CachedScoresEqualComputedOnesWhateverTheNetworkDoes) {
  const auto policy = make();
  RandomViews buffer;
  for (int i = 0; i < 100'000; ++i) {
    buffer.step();
    const BufferView view = buffer.view();
    ASSERT_EQ(policy->scores(view), naive_scores(view));
    if (view.waiting.size() > kCapacity) buffer.drop(policy->victim(view));
  }
  expect_each_extracted_once();
}

class OrbPolicyDropTest : public OrbPolicyTest {
 protected:
  /// Drops from 20,000 random views. The policy has prepared each; `check` sees the victim first.
  template <class Check>
  void drop_prepared(Check check) {
    const auto policy = make();
    RandomViews buffer;
    for (int i = 0; i < 20'000 && !HasFailure(); ++i) {
      buffer.step();
      const BufferView view = buffer.view();
      if (view.waiting.size() <= kCapacity) continue;
      while (policy->prepare(view)) {
      }
      const std::size_t victim = policy->victim(view);
      check(view, victim);
      buffer.drop(victim);
    }
  }
};

TEST_F(OrbPolicyDropTest, OneDropKeepsTheSmallestSimilarityAsLargeAsItCan) {
  table_ = walk_table;
  drop_prepared([this](const BufferView& view, std::size_t victim) {
    EXPECT_EQ(smallest_without(view, victim), best_smallest(view));
  });
}

// Where frames may be more like a further one than a nearer one, a drop can even raise the smallest
// similarity. The largest score need not be that drop, but it never loses what could be kept.
TEST_F(OrbPolicyDropTest, OneDropNeverLowersTheSmallestSimilarityWithoutNeed) {
  drop_prepared([this](const BufferView& view, std::size_t victim) {
    const int before = smallest_without(view, view.waiting.size());
    EXPECT_GE(smallest_without(view, victim), std::min(before, best_smallest(view)));
  });
}

}  // namespace
}  // namespace orbbuf
