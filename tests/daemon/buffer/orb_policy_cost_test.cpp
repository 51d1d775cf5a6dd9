// SPDX-License-Identifier: Apache-2.0
// What OrbPolicy extracts and compares, when, and what it does while that is not enough.
#include <gmock/gmock.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "daemon/buffer/frame_buffer.hpp"
#include "tests/daemon/buffer/orb_policy_fixture.hpp"

namespace orbbuf {
namespace {

using testing::Each;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Key;
using testing::Le;

constexpr std::size_t kCapacity = 25;

/// A buffer and its policy.
class OrbPolicyCostTest : public OrbPolicyTest {
 protected:
  /// What a push of that many frames cost.
  Cost push(Sequence first, Sequence last) {
    const Cost before = spent();
    for (Sequence sequence = first; sequence <= last; ++sequence) {
      capture_and_push(buffer_, sequence);
    }
    return spent() - before;
  }
  /// Frames 0 .. count - 1 are on their way, and but for the first may come back.
  void keep_up(Sequence count) {
    for (Sequence sequence = 0; sequence < count; ++sequence) {
      push(sequence, sequence);
      buffer_.take();
    }
    buffer_.acknowledge(1);
  }
  /// Each unit as small as promised.
  void prepare_all() {
    for (bool is_more = true; is_more;) {
      const Cost before = spent();
      is_more = buffer_.prepare();
      const Cost unit = spent() - before;
      EXPECT_LE(unit.extractions, 1);
      EXPECT_LE(unit.comparisons, unit.extractions == 1 ? 2 : 3);
      EXPECT_GE(unit.extractions + unit.comparisons, is_more ? 1 : 0);
    }
  }

  OrbPolicy* policy_ = make().release();  // owned by buffer_
  FrameBuffer buffer_{{kCapacity}, std::unique_ptr<DropPolicy>(policy_)};
};

TEST_F(OrbPolicyCostTest, NothingIsExtractedWhileTheLinkKeepsUp) {
  for (Sequence sequence = 0; sequence < 1'000; ++sequence) {
    push(sequence, sequence);
    EXPECT_FALSE(buffer_.prepare());
    buffer_.take();
    if (sequence > 5) buffer_.acknowledge(sequence - 5);
  }
  EXPECT_THAT(extractions_, IsEmpty());
}

TEST_F(OrbPolicyCostTest, WhenWaitingBeginsEveryFrameIsExtractedOnceByPreparing) {
  keep_up(5);
  EXPECT_EQ(push(5, 7).extractions, 0);
  EXPECT_THAT(extractions_, IsEmpty());
  prepare_all();
  EXPECT_THAT(extractions_, ElementsAre(Key(4), Key(5), Key(6), Key(7)));
  EXPECT_EQ(comparisons_, 2);  // 4 with 6, 5 with 7
  EXPECT_EQ(push(8, 8).extractions, 0);
  prepare_all();
  EXPECT_EQ(spent().extractions, 5);
  expect_each_extracted_once();
}

TEST_F(OrbPolicyCostTest, PreparingForNoMoreThanIsKnownCostsNothing) {
  keep_up(1);
  push(1, 20);
  prepare_all();
  const Cost before = spent();
  EXPECT_FALSE(buffer_.prepare());
  EXPECT_EQ((spent() - before).extractions, 0);
  EXPECT_EQ((spent() - before).comparisons, 0);
}

TEST_F(OrbPolicyCostTest, ABurstDelaysAPushByTwoExtractionsAndThreeComparisons) {
  keep_up(26);
  buffer_.return_in_flight();
  const Cost cost = push(26, 26);
  EXPECT_LE(cost.extractions, 2);
  EXPECT_LE(cost.comparisons, 3);
  EXPECT_EQ(buffer_.stats().dropped, 1U);
  prepare_all();
  EXPECT_GE(extractions_.size(), kCapacity);  // less the one given up, and with frame 0
  expect_each_extracted_once();
  EXPECT_EQ(push(27, 27).extractions, 1);
}

TEST_F(OrbPolicyCostTest, AllVictimsOfOnePushShareItsBudget) {
  keep_up(26);
  push(26, 50);
  prepare_all();
  buffer_.return_in_flight();
  const Cost cost = push(51, 51);
  EXPECT_EQ(buffer_.stats().waiting, kCapacity);
  EXPECT_EQ(buffer_.stats().dropped, 26U);
  EXPECT_LE(cost.extractions, 2);
  EXPECT_LE(cost.comparisons, 3);
  prepare_all();
  expect_each_extracted_once();
}

TEST_F(OrbPolicyCostTest, FramesThatComeBackAreNotExtractedAgain) {
  for (Sequence sequence = 0; sequence < 1'000; ++sequence) {
    push(sequence, sequence);
    if (sequence % 2 == 0) prepare_all();
    if (sequence % 7 == 0) {
      buffer_.return_in_flight();
      buffer_.resume(0);
    }
    if (sequence % 3 == 0) buffer_.take();
  }
  EXPECT_GT(extractions_.size(), 900U);
  expect_each_extracted_once();
}

TEST_F(OrbPolicyCostTest, AnArrivalCostsAtMostThreeComparisonsAndOneExtractionInAll) {
  keep_up(1);
  push(1, 2);
  prepare_all();  // two extractions, which is what it takes to begin
  std::mt19937_64 random(1);
  std::vector<int> costs;
  for (Sequence sequence = 3; sequence < 10'000; ++sequence) {
    const Cost before = spent();
    push(sequence, sequence);
    prepare_all();
    const Cost cost = spent() - before;
    ASSERT_LE(cost.extractions, sequence == 3 ? 2 : 1);
    costs.push_back(cost.comparisons);
    if (random() % 3 == 0) buffer_.take();
    if (random() % 5 == 0) buffer_.acknowledge(sequence);
  }
  EXPECT_THAT(costs, Each(Le(3)));
  EXPECT_EQ(std::ranges::max(costs), 3);
  expect_each_extracted_once();
}

TEST_F(OrbPolicyCostTest, WithoutIdleTimeAPushStillCostsTwoExtractionsAndThreeComparisons) {
  std::mt19937_64 random(1);
  for (Sequence sequence = 0; sequence < 10'000; ++sequence) {
    const Cost cost = push(sequence, sequence);
    ASSERT_LE(cost.extractions, 2);
    ASSERT_LE(cost.comparisons, 3);
    while (random() % 3 == 0) buffer_.take();
    if (random() % 5 == 0) buffer_.acknowledge(sequence);
    if (random() % 100 == 0) buffer_.return_in_flight();
  }
  expect_each_extracted_once();
}

TEST_F(OrbPolicyTest, TheVictimIsExactWheneverNoMoreIsMissingThanAnArrivalMayCost) {
  const auto policy = make();
  RandomViews buffer;
  std::optional<Sequence> newest;
  int exact = 0;
  int prepared = 0;
  for (int i = 0; i < 30'000; ++i) {
    buffer.step();
    const BufferView view = buffer.view();
    if (view.waiting.size() <= 8) continue;
    const bool is_arrival = newest != view.waiting.back()->sequence;
    newest = view.waiting.back()->sequence;
    OrbPolicy twin(*policy);
    const Cost before = spent();
    twin.scores(view);
    const Cost missing = spent() - before;
    const std::size_t victim = policy->victim(view);
    if (is_arrival && missing.extractions <= 2 && missing.comparisons <= 3) {
      ASSERT_EQ(victim, naive_victim(view));
      ++exact;
    }
    buffer.drop(victim);
    if (i % 3 == 0) prepared += policy->prepare(buffer.view()) ? 1 : 0;
  }
  EXPECT_GT(exact, 1'000);
  EXPECT_GT(prepared, 100);
}

TEST_F(OrbPolicyTest, PreparedScoresEqualComputedOnesWhateverTheNetworkDoes) {
  const auto policy = make();
  RandomViews buffer;
  for (int i = 0; i < 100'000; ++i) {
    buffer.step();
    const BufferView view = buffer.view();
    if (view.waiting.size() < 2) continue;
    if (i % 2 == 0) {
      while (policy->prepare(view)) {
      }
      const Cost before = spent();
      ASSERT_EQ(policy->scores(view), naive_scores(view));
      ASSERT_EQ((spent() - before).comparisons, 0);
      ASSERT_EQ(policy->victim(view), naive_victim(view));
    }
    if (view.waiting.size() > 8) buffer.drop(policy->victim(view));
  }
  expect_each_extracted_once();
}

TEST_F(OrbPolicyTest, InABurstTheFramesCompeteWhoseScoresAreKnown) {
  table_ = [](Sequence a, Sequence b) { return a == 1 && b == 3 ? 500 : 10; };
  BufferView view = view_of({1, 2, 3, 4, 5, 6, 7, 8, 9});
  const auto policy = make();
  EXPECT_EQ(policy->victim(view), 7U);  // of 9 and 7, all that an arrival may cost
  EXPECT_THAT(extractions_, ElementsAre(Key(7), Key(9)));
  while (policy->prepare(view)) {
  }
  EXPECT_EQ(policy->victim(view), 1U);
}

TEST_F(OrbPolicyTest, InABurstWithoutAKnownScoreTheSmallestGapInTimeGoes) {
  table_ = [](Sequence, Sequence) { return 10; };
  BufferView view = view_of({10U, 20U, 29U, 37U, 50U, 60U, 70U});
  const auto policy = make();
  const auto drop_victim = [&] {
    const std::size_t victim = policy->victim(view);
    view.waiting.erase(view.waiting.begin() + static_cast<std::ptrdiff_t>(victim));
  };
  drop_victim();  // 60, the only one whose score is known
  EXPECT_EQ(policy->victim(view), 2U);
  drop_victim();
  EXPECT_THAT(sequences_of(view.waiting), ElementsAre(10, 20, 37, 50, 70));
  EXPECT_EQ(spent().extractions, 2);
}

}  // namespace
}  // namespace orbbuf
