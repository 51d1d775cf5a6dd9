// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/orb_policy.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <utility>
#include <vector>

#include "daemon/buffer/frame_buffer.hpp"
#include "tests/daemon/buffer/frames.hpp"

namespace orbbuf {
namespace {

using testing::Each;
using testing::ElementsAre;
using testing::Le;

constexpr std::size_t kCapacity = 8;

/// 0 .. limit - 1, always the same for the same seed (the output step of SplitMix64).
int noise(std::uint64_t seed, std::uint64_t limit) {
  seed *= 0x9e3779b97f4a7c15;
  seed = (seed ^ (seed >> 30)) * 0xbf58476d1ce4e5b9;
  seed = (seed ^ (seed >> 27)) * 0x94d049bb133111eb;
  return static_cast<int>((seed ^ (seed >> 31)) % limit);
}

/// A policy whose frames have their sequence number as their only feature, and an M by table.
class OrbPolicyTest : public testing::Test {
 protected:
  /// M for two sequence numbers, the smaller first.
  using Table = std::function<int(Sequence, Sequence)>;

  static Sequence sequence_in(const FeatureSet& features) { return features.descriptors.at(0)[0]; }
  int m(Sequence a, Sequence b) const { return table_(std::min(a, b), std::max(a, b)); }

  std::unique_ptr<OrbPolicy> make() {
    return std::make_unique<OrbPolicy>(
        [this](const EncodedFrame& frame) {
          ++extractions_[frame.sequence];
          return FeatureSet{{Descriptor{frame.sequence}}};
        },
        [this](const FeatureSet& a, const FeatureSet& b) {
          ++comparisons_;
          return m(sequence_in(a), sequence_in(b));
        });
  }
  /// Few values, so that there are ties.
  static int random_table(Sequence a, Sequence b) { return noise(a * 1'000'003 + b, 12); }
  /// No frame is more like a further one than a nearer one: a walk through scenes, some of which
  /// are harder to leave than others.
  static int walk_table(Sequence a, Sequence b) {
    int m = 1'000;
    for (Sequence step = a; step < b && m > 0; ++step) {
      m -= noise(step, 300);
    }
    return std::max(m, 0);
  }
  std::vector<int> naive_scores(const BufferView& view) const {
    std::vector<int> scores;
    for (std::size_t i = 0; i + 1 < view.waiting.size(); ++i) {
      const FramePtr& left = view.left_of(i);
      scores.push_back(left ? m(left->sequence, view.waiting[i + 1]->sequence)
                            : OrbPolicy::kFreeToGo);
    }
    return scores;
  }
  /// The smallest similarity between neighbours in what is received, without waiting[gone].
  int smallest_without(const BufferView& view, std::size_t gone) const {
    int smallest = OrbPolicy::kFreeToGo;
    FramePtr left = view.previous;
    for (std::size_t i = 0; i < view.waiting.size(); ++i) {
      if (i == gone) continue;
      if (left) smallest = std::min(smallest, m(left->sequence, view.waiting[i]->sequence));
      left = view.waiting[i];
    }
    return smallest;
  }
  int best_smallest(const BufferView& view) const {
    int best = 0;
    for (std::size_t i = 0; i + 1 < view.waiting.size(); ++i) {
      best = std::max(best, smallest_without(view, i));
    }
    return best;
  }

  Table table_ = random_table;
  int comparisons_ = 0;
  std::map<Sequence, int> extractions_;
};

/// The views of a buffer whose network takes, acknowledges and returns at random.
class RandomViews {
 public:
  BufferView view() const {
    return {in_flight_.empty() ? acknowledged_ : in_flight_.back(),
            {waiting_.begin(), waiting_.end()}};
  }
  void drop(std::size_t index) {
    waiting_.erase(waiting_.begin() + static_cast<std::ptrdiff_t>(index));
  }
  void step() {
    const std::uint64_t choice = random_() % 16;
    if (choice < 8) {
      waiting_.push_back(make_frame_ptr(next_++));
    } else if (choice < 11 && !waiting_.empty()) {
      in_flight_.push_back(waiting_.front());
      waiting_.pop_front();
    } else if (choice < 15 && !in_flight_.empty()) {
      acknowledged_ = in_flight_.front();
      in_flight_.pop_front();
    } else if (choice == 15) {
      waiting_.insert(waiting_.begin(), in_flight_.begin(), in_flight_.end());
      in_flight_.clear();
    }
  }

 private:
  std::mt19937_64 random_{1};
  Sequence next_ = 0;
  std::deque<FramePtr> waiting_;
  std::deque<FramePtr> in_flight_;
  FramePtr acknowledged_;
};

TEST_F(OrbPolicyTest, NamesTheFrameWhoseNeighboursAreMostAlike) {
  table_ = [](Sequence a, Sequence b) { return a == 2 && b == 4 ? 50 : 10; };
  const BufferView view{make_frame_ptr(0),
                        {make_frame_ptr(1), make_frame_ptr(2), make_frame_ptr(3), make_frame_ptr(4),
                         make_frame_ptr(5)}};
  const auto policy = make();
  EXPECT_THAT(policy->scores(view), ElementsAre(10, 10, 50, 10));
  EXPECT_EQ(policy->victim(view), 2U);
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
  BufferView view{make_frame_ptr(0), {}};
  for (const Sequence sequence : {4U, 6U, 7U, 8U, 9U}) {
    view.waiting.push_back(make_frame_ptr(sequence));
  }
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
  for (const auto& [sequence, count] : extractions_) ASSERT_EQ(count, 1) << sequence;
}

TEST_F(OrbPolicyTest, OneDropKeepsTheSmallestSimilarityAsLargeAsItCan) {
  table_ = walk_table;
  const auto policy = make();
  RandomViews buffer;
  for (int i = 0; i < 20'000; ++i) {
    buffer.step();
    const BufferView view = buffer.view();
    if (view.waiting.size() <= kCapacity) continue;
    const std::size_t victim = policy->victim(view);
    ASSERT_EQ(smallest_without(view, victim), best_smallest(view));
    buffer.drop(victim);
  }
}

// Where frames may be more like a further one than a nearer one, a drop can even raise the smallest
// similarity. The largest score need not be that drop, but it never loses what could be kept.
TEST_F(OrbPolicyTest, OneDropNeverLowersTheSmallestSimilarityWithoutNeed) {
  const auto policy = make();
  RandomViews buffer;
  for (int i = 0; i < 20'000; ++i) {
    buffer.step();
    const BufferView view = buffer.view();
    if (view.waiting.size() <= kCapacity) continue;
    const std::size_t victim = policy->victim(view);
    const int before = smallest_without(view, view.waiting.size());
    ASSERT_GE(smallest_without(view, victim), std::min(before, best_smallest(view)));
    buffer.drop(victim);
  }
}

TEST_F(OrbPolicyTest, AnArrivalCostsAtMostThreeComparisonsAndOneExtraction) {
  FrameBuffer buffer(kCapacity, make());
  std::mt19937_64 random(1);
  std::vector<int> costs;
  for (Sequence sequence = 0; sequence < 10'000; ++sequence) {
    const int before = comparisons_;
    capture_and_push(buffer, sequence);
    costs.push_back(comparisons_ - before);
    while (random() % 3 == 0) buffer.take();
    if (random() % 5 == 0) buffer.acknowledge(sequence);
  }
  EXPECT_THAT(costs, Each(Le(3)));
  EXPECT_EQ(std::ranges::max(costs), 3);
  for (const auto& [sequence, count] : extractions_) ASSERT_EQ(count, 1) << sequence;
}

TEST_F(OrbPolicyTest, NothingIsExtractedWhileTheLinkKeepsUp) {
  FrameBuffer buffer(kCapacity, make());
  for (Sequence sequence = 0; sequence < 1'000; ++sequence) {
    capture_and_push(buffer, sequence);
    buffer.take();
    if (sequence > 5) buffer.acknowledge(sequence - 5);
  }
  EXPECT_TRUE(extractions_.empty());
}

TEST_F(OrbPolicyTest, FramesThatComeBackAreNotExtractedAgain) {
  FrameBuffer buffer(kCapacity, make());
  for (Sequence sequence = 0; sequence < 1'000; ++sequence) {
    capture_and_push(buffer, sequence);
    if (sequence % 7 == 0) {
      buffer.return_in_flight();
      buffer.resume(0);
    }
    if (sequence % 3 == 0) buffer.take();
  }
  EXPECT_GT(extractions_.size(), 900U);
  for (const auto& [sequence, count] : extractions_) ASSERT_EQ(count, 1) << sequence;
}

}  // namespace
}  // namespace orbbuf
