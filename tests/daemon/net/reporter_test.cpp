// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/reporter.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

using namespace std::chrono_literals;

class ReporterTest : public testing::Test {
 protected:
  ReporterTest() { reporter_.start(now_); }

  /// A second later, with so many frames captured and bytes acknowledged by the peer's kernel.
  void look(std::uint64_t captured, std::optional<std::uint64_t> acked_bytes) {
    now_ += 1s;
    std::optional<TcpProgress> progress;
    if (acked_bytes) progress = TcpProgress{*acked_bytes, 0, 0, 0, 40ms};
    reporter_.look(now_, {.captured = captured}, progress);
  }
  wire::Report take(std::uint64_t captured = 0) {
    return reporter_.take(now_, {{.captured = captured}, 25, 80'000});
  }

  Reporter::Time now_{};
  Reporter reporter_;
};

TEST_F(ReporterTest, ItIsTimeOnceASecond) {
  EXPECT_FALSE(reporter_.is_time(now_ + 999ms));
  EXPECT_TRUE(reporter_.is_time(now_ + 1s));
  look(1, 0);
  EXPECT_FALSE(reporter_.is_time(now_ + 999ms));
  EXPECT_TRUE(reporter_.is_time(now_ + 1s));
}

TEST_F(ReporterTest, AChangedAccountIsDueAtOnceAndTheSameOneAfterFourSeconds) {
  look(1, 0);
  EXPECT_TRUE(reporter_.is_due());
  take(1);
  EXPECT_FALSE(reporter_.is_due());
  for (int second = 1; second <= 4; ++second) {
    look(1, 0);
    EXPECT_EQ(reporter_.is_due(), second == 4) << second;
  }
  take(1);
  look(2, 0);
  EXPECT_TRUE(reporter_.is_due());
}

TEST_F(ReporterTest, TheRateIsThatOfTheLastSecond) {
  look(1, 1000);
  look(2, 251'000);
  const wire::Report report = take(2);
  EXPECT_EQ(report.link_rate, 250'000U);
  EXPECT_EQ(report.round_trip_us, 40'000U);
  EXPECT_EQ(report.capacity, 25U);
  EXPECT_EQ(report.waiting_bytes, 80'000U);
}

TEST_F(ReporterTest, WithoutAConnectionThereIsNoRateAndNoRoundTrip) {
  look(1, 1000);
  look(2, std::nullopt);
  EXPECT_EQ(take().link_rate, 0U);
  EXPECT_EQ(take().round_trip_us, 0U);
}

TEST_F(ReporterTest, ANewConnectionCountsFromNothing) {
  look(1, 1'000'000);
  look(2, 3000);
  EXPECT_EQ(take().link_rate, 3000U);
}

}  // namespace
}  // namespace orbbuf
