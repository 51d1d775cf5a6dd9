// SPDX-License-Identifier: Apache-2.0
#include "server/recording/robot_holds.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

TEST(RobotHolds, AreALineWithAHeader) {
  const RobotHolds holds{12, 345, 1'500'000'000};
  EXPECT_EQ(to_csv(holds), "held,first,reported_s\n12,345,1.500000000\n");
  EXPECT_EQ(holds_from_csv(to_csv(holds)), holds);
}

TEST(RobotHolds, OfNothingThereIsNoFirst) {
  EXPECT_EQ(to_csv(RobotHolds{0, 7, 0}), "held,first,reported_s\n0,,0.000000000\n");
  EXPECT_EQ(holds_from_csv(to_csv(RobotHolds{0, 7, 0})), RobotHolds{});
}

TEST(RobotHolds, WhatIsNotThatIsNothing) {
  for (const char* text :
       {"", "held,first,reported_s\n", "held,first,reported_s\n12,345,1.500000000",
        "held,first,reported_s\n12,,1.500000000\n", "held,first,reported_s\n12,x,1.500000000\n",
        "held,first,reported_s\n12,1.500000000\n", "held,first\n12,345\n",
        "held,first,reported_s\n-1,345,1.500000000\n", "held,first,reported_s\n1,345,\n"}) {
    EXPECT_EQ(holds_from_csv(text), std::nullopt) << text;
  }
}

}  // namespace
}  // namespace orbbuf
