// SPDX-License-Identifier: Apache-2.0
#include "evaluation/trial/report.hpp"

#include <gtest/gtest.h>

#include <numeric>
#include <vector>

namespace orbbuf::evaluation {
namespace {

TEST(Share, HasWilsonsInterval) {
  const auto [low, high] = Share{19, 20}.interval();  // 0.764 to 0.991 in the tables
  EXPECT_NEAR(low, 0.764, 0.001);
  EXPECT_NEAR(high, 0.991, 0.001);
  EXPECT_EQ(Share({20, 20}).interval().second, 1);
}

TEST(MedianOf, HasTheIntervalOfTheOrder) {
  std::vector<double> values(70);
  std::iota(values.rbegin(), values.rend(), 1);
  const Median median = median_of(values);
  EXPECT_EQ(median.middle, 36);
  EXPECT_EQ(median.low, 27);  // the 27th of 70, as tables of the sign test have it
  EXPECT_EQ(median.high, 44);
}

TEST(MedianOf, FewValuesHaveAWideInterval) {
  EXPECT_EQ(median_of({3}).middle, 3);
  const Median five = median_of({5, 1, 2, 4, 3});
  EXPECT_EQ(five.low, 1);
  EXPECT_EQ(five.high, 5);
  const Median nine = median_of({9, 8, 7, 6, 5, 4, 3, 2, 1});
  EXPECT_EQ(nine.low, 2);
  EXPECT_EQ(nine.high, 8);
}

}  // namespace
}  // namespace orbbuf::evaluation
