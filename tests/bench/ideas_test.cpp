// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/ideas.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <limits>
#include <memory>
#include <random>
#include <vector>

namespace orbbuf::sim {
namespace {

using Table = std::vector<std::vector<int>>;

FramePtr frame(Sequence sequence) {
  EncodedFrame frame;
  frame.sequence = sequence;
  frame.capture_time_ns = static_cast<std::int64_t>(sequence) * 40'000'000;
  return std::make_shared<const EncodedFrame>(std::move(frame));
}

/// Frame 0 before, `count` waiting.
BufferView view(std::size_t count) {
  BufferView view{frame(0), {}};
  for (std::size_t i = 1; i <= count; ++i) view.waiting.push_back(frame(i));
  return view;
}

Table random_table(std::mt19937& random, std::size_t count) {
  Table table(count, std::vector<int>(count));
  for (std::size_t i = 0; i < count; ++i) {
    for (std::size_t j = 0; j <= i; ++j)
      table[i][j] = table[j][i] = static_cast<int>(random() % 50);
  }
  return table;
}

/// The smallest similarity between neighbours once waiting[victim] has gone.
int smallest_after(const Table& table, const BufferView& view, std::size_t victim) {
  int smallest = std::numeric_limits<int>::max();
  std::size_t left = view.previous->sequence;
  for (std::size_t i = 0; i < view.waiting.size(); ++i) {
    if (i == victim) continue;
    smallest = std::min(smallest, table[left][view.waiting[i]->sequence]);
    left = view.waiting[i]->sequence;
  }
  return smallest;
}

class IdeasTest : public testing::TestWithParam<std::string_view> {};

TEST_P(IdeasTest, GiveUpAWaitingFrameThatIsNotTheNewest) {
  std::mt19937 random(1);
  for (std::size_t count = 2; count < 20; ++count) {
    const Table table = random_table(random, count + 1);
    const auto policy =
        make_idea(GetParam(), [&](std::size_t i, std::size_t j) { return table[i][j]; });
    EXPECT_LT(policy->victim(view(count)), count - 1);
    BufferView headless = view(count);
    headless.previous = nullptr;
    EXPECT_EQ(policy->victim(headless), 0U);
  }
}

INSTANTIATE_TEST_SUITE_P(All, IdeasTest, testing::ValuesIn(kIdeas));

TEST(Ideas, Eq3IsTheBestSingleDropOnAnyTable) {
  std::mt19937 random(2);
  for (int round = 0; round < 1000; ++round) {
    const std::size_t count = 2 + random() % 10;
    const Table table = random_table(random, count + 1);
    const BufferView waiting = view(count);
    int best = -1;
    for (std::size_t i = 0; i + 1 < count; ++i) {
      best = std::max(best, smallest_after(table, waiting, i));
    }
    const auto policy = make_idea("eq3", [&](std::size_t i, std::size_t j) { return table[i][j]; });
    ASSERT_EQ(smallest_after(table, waiting, policy->victim(waiting)), best) << "round " << round;
  }
}

}  // namespace
}  // namespace orbbuf::sim
