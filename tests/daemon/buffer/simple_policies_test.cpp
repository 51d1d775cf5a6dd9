// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/simple_policies.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "tests/daemon/buffer/frames.hpp"

namespace orbbuf {
namespace {

FramePtr at(std::int64_t time) {
  EncodedFrame frame;
  frame.capture_time_ns = time;
  return std::make_shared<const EncodedFrame>(std::move(frame));
}

BufferView view_at(const std::vector<std::int64_t>& times) {
  BufferView view;
  for (const std::int64_t time : times) view.waiting.push_back(at(time));
  return view;
}

TEST(DropOldestPolicyTest, NamesTheHead) {
  EXPECT_EQ(DropOldestPolicy().victim(view_at({1, 2})), 0U);
  EXPECT_EQ(DropOldestPolicy().victim(view_at({1, 2, 3, 4, 5})), 0U);
}

TEST(DropYoungestPolicyTest, NamesTheOneBeforeTheNewest) {
  EXPECT_EQ(DropYoungestPolicy().victim(view_at({1, 2})), 0U);
  EXPECT_EQ(DropYoungestPolicy().victim(view_at({1, 2, 3, 4, 5})), 3U);
}

TEST(RandomPolicyTest, NamesAllButTheNewestEquallyOften) {
  RandomPolicy policy(1);
  const BufferView view = view_at({1, 2, 3, 4, 5, 6});
  std::array<int, 6> counts{};
  for (int i = 0; i < 50'000; ++i) ++counts[policy.victim(view)];
  for (int i = 0; i < 5; ++i) EXPECT_NEAR(counts[static_cast<std::size_t>(i)], 10'000, 400);
  EXPECT_EQ(counts[5], 0);
}

TEST(RandomPolicyTest, ChoosesTheSameOnEveryPlatform) {
  RandomPolicy policy(1);
  const BufferView view = view_at(std::vector<std::int64_t>(26));
  for (const std::size_t choice : {3U, 12U, 5U, 21U, 9U}) EXPECT_EQ(policy.victim(view), choice);
}

TEST(UniformPolicyTest, NamesTheFrameWhoseNeighboursAreClosest) {
  BufferView view = view_at({10, 20, 27, 35, 50});
  view.previous = at(0);
  EXPECT_EQ(UniformPolicy().victim(view), 2U);
}

TEST(UniformPolicyTest, NamesTheOlderOfEquals) {
  BufferView view = view_at({10, 20, 30, 40});
  view.previous = at(0);
  EXPECT_EQ(UniformPolicy().victim(view), 0U);
}

TEST(UniformPolicyTest, JudgesTheHeadByTheFrameSentBeforeIt) {
  BufferView view = view_at({10, 20, 30, 40});
  view.previous = at(-5);
  EXPECT_EQ(UniformPolicy().victim(view), 1U);
}

TEST(UniformPolicyTest, NamesAHeadWithNothingBeforeIt) {
  EXPECT_EQ(UniformPolicy().victim(view_at({0, 1'000, 1'001, 1'002})), 0U);
}

TEST(UniformPolicyTest, KeepsTheFramesAroundAClockThatWasSetBack) {
  BufferView view = view_at({1'010, 1'020, 10, 20, 30});
  view.previous = at(1'000);
  EXPECT_EQ(UniformPolicy().victim(view), 0U);
}

TEST(UniformPolicyTest, ThinsALongOutageEvenly) {
  UniformPolicy policy;
  BufferView view;
  view.previous = at(0);
  for (int time = 1; time <= 160; ++time) {
    view.waiting.push_back(at(time));
    if (view.waiting.size() <= 10) continue;
    view.waiting.erase(view.waiting.begin() + static_cast<std::ptrdiff_t>(policy.victim(view)));
  }
  for (std::size_t i = 0; i < view.waiting.size(); ++i) {
    EXPECT_LE(view.waiting[i]->capture_time_ns - view.left_of(i)->capture_time_ns, 32);
  }
}

}  // namespace
}  // namespace orbbuf
