// SPDX-License-Identifier: Apache-2.0
#include "evaluation/trial/report.hpp"

#include <gtest/gtest.h>

namespace orbbuf::evaluation {
namespace {

TEST(Share, HasWilsonsInterval) {
  const auto [low, high] = Share{19, 20}.interval();  // 0.764 to 0.991 in the tables
  EXPECT_NEAR(low, 0.764, 0.001);
  EXPECT_NEAR(high, 0.991, 0.001);
  EXPECT_EQ(Share({20, 20}).interval().second, 1);
}

}  // namespace
}  // namespace orbbuf::evaluation
