// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/fifo_oracle.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <random>
#include <set>
#include <vector>

namespace orbbuf::sim {
namespace {

using Frames = std::vector<std::size_t>;

/// Arrivals (true) and takes (false) in the order they happen; a take finds a frame waiting.
struct Story {
  std::size_t capacity = 0;
  std::vector<bool> arrivals;
};

Story random_story(std::mt19937& random, std::size_t frames) {
  Story story{3 + random() % 2, {}};
  std::size_t waiting = 0;
  for (std::size_t arrived = 0; arrived < frames || waiting > 0;) {
    const bool arrives = arrived < frames && (waiting == 0 || random() % 10 < 7);
    story.arrivals.push_back(arrives);
    if (arrives) {
      ++arrived;
      waiting = std::min(waiting + 1, story.capacity);
    } else {
      --waiting;
    }
  }
  return story;
}

/// Plays a story with every drop decision there is: any waiting frame but the newest.
class EveryPolicy {
 public:
  explicit EveryPolicy(const Story& story) : story_(story) { play(0, {}, {}, 0); }

  const std::set<Frames>& received() const { return all_; }

 private:
  void play(std::size_t step, Frames waiting, Frames received, std::size_t arrived) {
    for (; step < story_.arrivals.size(); ++step) {
      if (!story_.arrivals[step]) {
        received.push_back(waiting.front());
        waiting.erase(waiting.begin());
        continue;
      }
      waiting.push_back(arrived++);
      if (waiting.size() <= story_.capacity) continue;
      for (std::size_t i = 0; i + 1 < waiting.size(); ++i) {
        Frames without = waiting;
        without.erase(without.begin() + static_cast<std::ptrdiff_t>(i));
        play(step + 1, without, received, arrived);
      }
      return;
    }
    all_.insert(received);
  }

  const Story& story_;
  std::set<Frames> all_;
};

/// The counts that a story forces on every policy.
Delivery delivery_of(const Story& story) {
  Delivery delivery;
  std::size_t waiting = 0;
  std::size_t dropped = 0;
  for (const bool arrives : story.arrivals) {
    if (arrives) {
      if (waiting == story.capacity) {
        ++dropped;
      } else {
        ++waiting;
      }
      delivery.drops_after.push_back(dropped);
    } else {
      --waiting;
      delivery.received.push_back(0);  // whichever
      delivery.drops_before.push_back(dropped);
    }
  }
  return delivery;
}

void every_sequence(const Choices& choices, Frames& prefix, std::set<Frames>& all) {
  const std::size_t k = prefix.size();
  if (k == choices.first.size()) {
    all.insert(prefix);
    return;
  }
  for (std::size_t frame = choices.first[k]; frame <= choices.last[k]; ++frame) {
    if (k > 0 && frame <= prefix.back()) continue;
    prefix.push_back(frame);
    every_sequence(choices, prefix, all);
    prefix.pop_back();
  }
}

int smallest(const Frames& frames, const PairSimilarity& similarity) {
  int value = std::numeric_limits<int>::max();
  for (std::size_t k = 1; k < frames.size(); ++k) {
    value = std::min(value, similarity(frames[k - 1], frames[k]));
  }
  return value;
}

TEST(FifoOracle, ChoosesAmongExactlyWhatSomePolicyCouldDeliver) {
  std::mt19937 random(1);
  for (int round = 0; round < 100; ++round) {
    const Story story = random_story(random, 9);
    std::set<Frames> chosen;
    Frames prefix;
    every_sequence(choices(delivery_of(story)), prefix, chosen);
    ASSERT_EQ(chosen, EveryPolicy(story).received()) << "round " << round;
  }
}

TEST(FifoOracle, FindsTheBestOfThem) {
  std::mt19937 random(2);
  for (int round = 0; round < 100; ++round) {
    const Story story = random_story(random, 9);
    std::vector<std::vector<int>> table(9, std::vector<int>(9));
    for (auto& row : table) {
      for (int& value : row) value = static_cast<int>(random() % 30);
    }
    const PairSimilarity similarity = [&](std::size_t i, std::size_t j) { return table[i][j]; };
    int best = -1;
    const EveryPolicy every_policy(story);
    for (const Frames& frames : every_policy.received()) {
      best = std::max(best, smallest(frames, similarity));
    }
    const Frames found = fifo_oracle(delivery_of(story), similarity);
    ASSERT_EQ(smallest(found, similarity), best) << "round " << round;
    ASSERT_TRUE(every_policy.received().contains(found)) << "round " << round;
  }
}

TEST(FifoOracle, HasNoChoiceWhereNothingIsDropped) {
  const Delivery all{{0, 1, 2}, {}, {}, {0, 0, 0}, {0, 0, 0}};
  EXPECT_THAT(fifo_oracle(all, [](std::size_t, std::size_t) { return 0; }),
              testing::ElementsAre(0, 1, 2));
}

}  // namespace
}  // namespace orbbuf::sim
