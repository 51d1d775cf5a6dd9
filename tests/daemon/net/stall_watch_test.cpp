// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/stall_watch.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

using namespace std::chrono_literals;

class StallWatchTest : public testing::Test {
 protected:
  /// The kernel's word `after` the last: so many bytes acknowledged, and what is outstanding.
  void look(std::chrono::milliseconds after, std::uint64_t acked_bytes, std::uint32_t unacked,
            std::chrono::microseconds round_trip = 10ms, std::uint32_t probes = 0) {
    now_ += after;
    watch_.look(TcpProgress{acked_bytes, unacked, 0, probes, round_trip}, now_);
  }

  StallWatch watch_{1s};
  StallWatch::Time now_{};
};

TEST_F(StallWatchTest, NothingAcknowledgedForTheTimeoutIsAStall) {
  look(0ms, 100, 5);
  look(999ms, 100, 5);
  EXPECT_FALSE(watch_.is_moving());
  EXPECT_FALSE(watch_.is_stalled());
  look(1ms, 100, 5);
  EXPECT_TRUE(watch_.is_stalled());
  EXPECT_EQ(watch_.still_for(), 1s);
}

TEST_F(StallWatchTest, ASlowLinkMoves) {
  for (std::uint64_t bytes = 1; bytes < 20; ++bytes) {
    look(900ms, bytes, 5);
    EXPECT_TRUE(watch_.is_moving());
  }
}

TEST_F(StallWatchTest, NothingOutstandingIsNoStall) {
  look(0ms, 100, 5);
  look(60s, 100, 0);
  EXPECT_TRUE(watch_.is_moving());
  look(900ms, 100, 5);
  EXPECT_FALSE(watch_.is_stalled()) << "counted from when something is outstanding";
}

TEST_F(StallWatchTest, UnansweredProbesOfAFullWindowAreOutstanding) {
  look(0ms, 100, 0, 10ms, 1);
  look(1s, 100, 0, 10ms, 2);
  EXPECT_TRUE(watch_.is_stalled());
}

TEST_F(StallWatchTest, ALongRoundTripIsGivenTwoOfIt) {
  look(0ms, 100, 5, 600ms);
  look(1199ms, 100, 5, 600ms);
  EXPECT_FALSE(watch_.is_stalled());
  look(1ms, 100, 5, 600ms);
  EXPECT_TRUE(watch_.is_stalled());
}

TEST_F(StallWatchTest, AKernelThatCannotTellCountsAsMoving) {
  look(0ms, 100, 5);
  watch_.look(std::nullopt, now_ + 5s);
  EXPECT_TRUE(watch_.is_moving());
}

TEST_F(StallWatchTest, ANewConnectionBeginsAnew) {
  look(0ms, 100, 5);
  look(5s, 100, 5);
  ASSERT_TRUE(watch_.is_stalled());
  watch_.restart(now_);
  EXPECT_TRUE(watch_.is_moving());
  look(999ms, 0, 5);
  EXPECT_FALSE(watch_.is_stalled());
}

}  // namespace
}  // namespace orbbuf
