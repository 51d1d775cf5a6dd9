// SPDX-License-Identifier: Apache-2.0
#include "evaluation/trial/scene.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <stdexcept>
#include <vector>

namespace orbbuf::evaluation {
namespace {

TEST(StretchAround, GoesOnBehindTheFirstFrameAfterTheOutage) {
  const std::vector<std::size_t> in_time{90, 99, 150, 151};
  const auto stretch = stretch_around({100, 150}, in_time, 25, 1000);
  ASSERT_TRUE(stretch);
  EXPECT_EQ(stretch->begin, 75U);
  EXPECT_EQ(stretch->end, 200U);
  const std::vector<std::size_t> late{90, 99, 230, 231};
  const auto later = stretch_around({100, 150}, late, 25, 1000);
  ASSERT_TRUE(later);
  EXPECT_EQ(later->end, 280U);
}

TEST(StretchAround, StaysInTheSequence) {
  const std::vector<std::size_t> received{0, 95};
  const auto stretch = stretch_around({10, 60}, received, 25, 100);
  ASSERT_TRUE(stretch);
  EXPECT_EQ(stretch->begin, 0U);
  EXPECT_EQ(stretch->end, 100U);
}

TEST(StretchAround, WhoIsNotBackHasNone) {
  const std::vector<std::size_t> gone{90, 99};
  EXPECT_FALSE(stretch_around({100, 150}, gone, 25, 1000));
}

TEST(LongestGap, CountsWhatIsMissingAtTheEnds) {
  const std::vector<std::size_t> received{3, 4, 7, 15, 16};
  EXPECT_EQ(longest_gap(received, {3, 17}), 7U);
  EXPECT_EQ(longest_gap(received, {3, 25}), 8U);
  EXPECT_EQ(longest_gap(received, {0, 8}), 3U);
  EXPECT_EQ(longest_gap(received, {5, 7}), 2U);
  EXPECT_EQ(longest_gap(received, {17, 40}), 23U);
  EXPECT_EQ(longest_gap({}, {0, 10}), 10U);
  EXPECT_EQ(longest_gap(received, {20, 10}), 0U);
}

TEST(ForEachParallel, DoesEachOnceAndThrowsOn) {
  std::atomic<int> sum = 0;
  for_each_parallel("test", 100, [&](std::size_t i) { sum += static_cast<int>(i); });
  EXPECT_EQ(sum, 4950);
  EXPECT_THROW(for_each_parallel("test", 10, [](std::size_t) { throw std::runtime_error("x"); }),
               std::runtime_error);
}

}  // namespace
}  // namespace orbbuf::evaluation
