// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "daemon/record/record.hpp"

namespace orbbuf {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

const WritePace::Clock::time_point kStart{std::chrono::hours(1)};

TEST(WritePace, WithoutALimitAWriteMayAlwaysBegin) {
  WritePace pace(0);
  for (int i = 0; i < 10; ++i) pace.spend(1ULL << 40, kStart);
  EXPECT_LE(pace.next(), kStart);
}

TEST(WritePace, OneSecondsWorthComesAtOnce) {
  WritePace pace(1000);
  EXPECT_LE(pace.next(), kStart);
  pace.spend(999, kStart);
  EXPECT_LE(pace.next(), kStart);
  pace.spend(1, kStart);
  EXPECT_EQ(pace.next(), kStart);
  pace.spend(1, kStart);
  EXPECT_EQ(pace.next(), kStart + milliseconds(1));
}

TEST(WritePace, AnIdleTimeEarnsNoMoreThanThat) {
  WritePace pace(1000);
  pace.spend(1, kStart);
  pace.spend(1500, kStart + seconds(100));
  EXPECT_EQ(pace.next(), kStart + seconds(100) + milliseconds(500));
}

TEST(WritePace, SomethingLargeDelaysWhatComesAfterIt) {
  WritePace pace(1000);
  pace.spend(10'000, kStart);
  EXPECT_EQ(pace.next(), kStart + seconds(9));
}

TEST(WritePace, KeepsTheRateOverALongTime) {
  WritePace pace(1000);
  auto now = kStart;
  for (int i = 0; i < 1000; ++i) {
    now = std::max(now, pace.next());
    pace.spend(50, now);
  }
  EXPECT_EQ(now, kStart + milliseconds(999 * 50) - seconds(1));
}

}  // namespace
}  // namespace orbbuf
