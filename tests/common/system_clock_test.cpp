// SPDX-License-Identifier: Apache-2.0
#include "common/system_clock.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

TEST(SystemClock, TheMachinesClocksAreRead) {
  const SystemClockReading first = read_system_clock();
  const SystemClockReading second = read_system_clock();
  EXPECT_GT(first.since_boot, std::chrono::nanoseconds(0));
  EXPECT_GE(second.since_boot, first.since_boot);
  EXPECT_LT(std::chrono::abs(first.wall - std::chrono::system_clock::now()),
            std::chrono::minutes(1));
}

}  // namespace
}  // namespace orbbuf
