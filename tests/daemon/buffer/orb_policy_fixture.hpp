// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <random>
#include <vector>

#include "daemon/buffer/orb_policy.hpp"
#include "tests/daemon/buffer/frames.hpp"

/// What the tests of OrbPolicy share.
namespace orbbuf {

/// 0 .. limit - 1, always the same for the same seed (the output step of SplitMix64).
inline int noise(std::uint64_t seed, std::uint64_t limit) {
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
        [this](const EncodedFrame& frame, FeatureSet& features) {
          ++extraction_count_;
          ++extractions_[frame.sequence];
          features.descriptors.assign(1, Descriptor{frame.sequence});
        },
        [this](const FeatureSet& a, const FeatureSet& b) {
          ++comparisons_;
          return m(sequence_in(a), sequence_in(b));
        });
  }
  /// Frame 0 has gone before.
  static BufferView view_of(const std::vector<Sequence>& waiting) {
    BufferView view{make_frame_ptr(0), {}};
    for (const Sequence sequence : waiting) view.waiting.push_back(make_frame_ptr(sequence));
    return view;
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

  /// The index of the largest; of equals by the smaller gap in time, then the older.
  std::size_t naive_victim(const BufferView& view) const {
    const std::vector<int> scores = naive_scores(view);
    std::size_t best = 0;
    for (std::size_t i = 1; i < scores.size(); ++i) {
      if (scores[i] < scores[best]) continue;
      if (scores[i] > scores[best] || view.gap_without(i) < view.gap_without(best)) best = i;
    }
    return best;
  }
  /// What has been spent so far.
  struct Cost {
    int extractions = 0;
    int comparisons = 0;
    Cost operator-(const Cost& b) const {
      return {extractions - b.extractions, comparisons - b.comparisons};
    }
  };
  Cost spent() const { return {extraction_count_, comparisons_}; }
  void expect_each_extracted_once() const {
    for (const auto& [sequence, count] : extractions_) EXPECT_EQ(count, 1) << sequence;
  }

  Table table_ = random_table;
  int comparisons_ = 0;
  int extraction_count_ = 0;
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

}  // namespace orbbuf
