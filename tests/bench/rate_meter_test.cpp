// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/rate_meter.hpp"

#include <gtest/gtest.h>

namespace orbbuf::sim {
namespace {

TEST(RateMeter, KnowsNothingBeforeTheFirstSend) {
  RateMeter meter;
  EXPECT_EQ(meter.bytes_per_s(), 0);
  meter.on_sent(1000, 0);
  EXPECT_EQ(meter.bytes_per_s(), 0);
}

TEST(RateMeter, GivesTheRateOfASteadyLink) {
  RateMeter meter;
  for (int i = 1; i < 50; ++i) meter.on_sent(static_cast<std::size_t>(100 * i), 0.01 * i);
  EXPECT_NEAR(meter.bytes_per_s(), 10'000, 1e-6);
}

TEST(RateMeter, FollowsALinkThatChanges) {
  RateMeter meter;
  for (int i = 0; i < 100; ++i) meter.on_sent(1000, 0.1);
  for (int i = 0; i < 60; ++i) meter.on_sent(1000, 0.05);  // three time constants
  EXPECT_NEAR(meter.bytes_per_s(), 20'000, 1000);
}

TEST(RateMeter, TakesAnOutageForNoMoreThanFourSends) {
  RateMeter outage;
  RateMeter slow;
  for (int i = 0; i < 100; ++i) {
    outage.on_sent(1000, 0.1);
    slow.on_sent(1000, 0.1);
  }
  outage.on_sent(1000, 60);
  slow.on_sent(1000, 0.4);
  EXPECT_DOUBLE_EQ(outage.bytes_per_s(), slow.bytes_per_s());
  EXPECT_GT(outage.bytes_per_s(), 5000);
}

}  // namespace
}  // namespace orbbuf::sim
