// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "server/retention/retention.hpp"

namespace orbbuf {
namespace {

using std::chrono::hours;
using std::chrono::minutes;
using std::chrono::nanoseconds;

class ClockTrustTest : public testing::Test {
 protected:
  /// Time passes by both clocks, and the wall's is set by `step` besides.
  bool trusts_after(nanoseconds passed, nanoseconds step = {}) {
    now_.since_boot += passed;
    now_.wall += std::chrono::duration_cast<std::chrono::system_clock::duration>(passed + step);
    return trust_.trusts(now_, last_write_);
  }

  const std::chrono::system_clock::time_point last_write_{hours(490'000)};
  SystemClockReading now_{last_write_, minutes(1), false};
  ClockTrust trust_;
};

TEST_F(ClockTrustTest, AClockThatRunsEvenlyIsTrusted) {
  EXPECT_TRUE(trusts_after(minutes(1)));
  for (int i = 0; i < 1000; ++i) ASSERT_TRUE(trusts_after(hours(1), minutes(59)));
  EXPECT_TRUE(trusts_after(ClockTrust::kMostGap * 2)) << "sleep is not a jump";
}

TEST_F(ClockTrustTest, AClockThatWasSetIsNotTrustedForADay) {
  for (const auto step : {hours(60 * 24), hours(-60 * 24)}) {
    ASSERT_TRUE(trusts_after(minutes(1)));
    EXPECT_FALSE(trusts_after(minutes(1), step));
    EXPECT_FALSE(trusts_after(ClockTrust::kQuarantine - minutes(1)));
    EXPECT_TRUE(trusts_after(minutes(1)));
  }
}

TEST_F(ClockTrustTest, AStartLongAfterTheLastWriteIsNotTrustedForADay) {
  EXPECT_FALSE(trusts_after(minutes(1), ClockTrust::kMostGap));
  EXPECT_FALSE(trusts_after(minutes(1)));
  EXPECT_TRUE(trusts_after(ClockTrust::kQuarantine));
}

TEST_F(ClockTrustTest, ASynchronisedClockIsTrustedAtOnce) {
  EXPECT_FALSE(trusts_after(minutes(1), ClockTrust::kMostGap));
  now_.is_synchronised = true;
  EXPECT_TRUE(trusts_after(minutes(1), hours(-60 * 24)));
  now_.is_synchronised = false;
  EXPECT_TRUE(trusts_after(minutes(1)));
}

}  // namespace
}  // namespace orbbuf
