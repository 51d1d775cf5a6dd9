// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/link_rate.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <deque>

#include "common/seconds.hpp"

namespace orbbuf {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr std::size_t kBytes = 40'000;

/// A link on a clock of its own: serves one frame after the other, and acknowledges each half a
/// round trip after it came.
class LinkRateTest : public testing::Test {
 protected:
  void write() {
    const LinkRate::Time there = now_ + round_trip_ / 2;
    const auto service = nanoseconds(std::llround(1e9 * kBytes / true_rate_));
    served_ = std::max(served_, there) + service;
    acks_.push_back({next_ + 1, served_ + round_trip_ / 2});
    rate_.on_written(now_, next_++, kBytes);
  }
  void acknowledge_until(LinkRate::Time time) {
    while (!acks_.empty() && acks_.front().time <= time) {
      now_ = acks_.front().time;
      rate_.on_received(now_, acks_.front().next, round_trip_);
      acks_.pop_front();
    }
    now_ = time;
  }
  /// A camera with a frame every `interval`, each of which is written if there is room.
  void run(int frames, nanoseconds interval) {
    for (int i = 0; i < frames; ++i) {
      if (rate_.has_room(round_trip_)) write();
      largest_window_ = std::max(largest_window_, acks_.size());
      acknowledge_until(now_ + interval);
    }
  }
  void expect_rate(double rate) { EXPECT_NEAR(rate_.bytes_per_s(), rate, 0.05 * rate); }

  struct Ack {
    Sequence next = 0;
    LinkRate::Time time;
  };
  LinkRate rate_;
  double true_rate_ = 1e6;
  nanoseconds round_trip_{0};
  LinkRate::Time now_;
  LinkRate::Time served_;
  Sequence next_ = 0;
  std::deque<Ack> acks_;
  std::size_t largest_window_ = 0;
};

TEST_F(LinkRateTest, IsUnknownUntilAFrameIsAcknowledged) {
  EXPECT_EQ(rate_.bytes_per_s(), 0);
  write();
  EXPECT_EQ(rate_.bytes_per_s(), 0);
}

TEST_F(LinkRateTest, IsTheLinksWhetherTheCameraOrTheLinkIsSlower) {
  for (const double rate : {1e4, 1e6, 1e9}) {
    for (const int interval_ms : {1, 40, 400}) {
      rate_ = {};
      true_rate_ = rate;
      run(100, milliseconds(interval_ms));
      acknowledge_until(now_ + std::chrono::hours(1));
      expect_rate(rate);
    }
  }
}

TEST_F(LinkRateTest, ARoundTripIsNoService) {
  round_trip_ = milliseconds(300);
  run(100, milliseconds(40));
  expect_rate(1e6);
}

TEST_F(LinkRateTest, FramesThatAreAcknowledgedTogetherCountTogether) {
  for (int i = 0; i < 20; ++i) {
    write();
    write();
    acks_.pop_front();  // the first one's word is the second one's, too
    acknowledge_until(now_ + milliseconds(80));
  }
  expect_rate(1e6);
}

TEST_F(LinkRateTest, AnOutageIsNoSlowLink) {
  run(100, milliseconds(40));
  write();
  served_ += std::chrono::seconds(10);
  acks_.back().time += std::chrono::seconds(10);
  acknowledge_until(now_ + std::chrono::seconds(11));
  EXPECT_GT(rate_.bytes_per_s(), 0.8e6);
  run(30, milliseconds(40));
  expect_rate(1e6);
}

TEST_F(LinkRateTest, ALinkThatBecameSlowIsKnownWithinSeconds) {
  true_rate_ = 1e8;
  run(1000, milliseconds(40));
  true_rate_ = 1e5;
  const LinkRate::Time begin = now_;
  while (rate_.bytes_per_s() > 2e5) {
    ASSERT_LT(now_ - begin, std::chrono::seconds(20));
    run(1, milliseconds(40));
  }
}

TEST_F(LinkRateTest, WhatABrokenConnectionHadIsNoObservation) {
  run(100, milliseconds(40));
  write();
  rate_.on_lost();
  acks_.clear();
  now_ += std::chrono::seconds(10);
  served_ = now_;
  run(3, milliseconds(40));
  expect_rate(1e6);
}

TEST_F(LinkRateTest, WithoutAcknowledgementsTwoFramesAreAllThatIsWritten) {
  for (int i = 0; i < 10; ++i) {
    if (rate_.has_room(round_trip_)) write();
  }
  EXPECT_EQ(acks_.size(), 2U);
}

TEST_F(LinkRateTest, BeyondTheTwoFramesIsWhatTakes100MsAndTwoRoundTrips) {
  true_rate_ = 4e6;  // 10 ms a frame
  run(1000, milliseconds(1));
  EXPECT_NEAR(static_cast<double>(largest_window_), 10, 1);
  round_trip_ = milliseconds(50);
  run(1000, milliseconds(1));
  EXPECT_NEAR(static_cast<double>(largest_window_), 20, 1);
}

TEST_F(LinkRateTest, TheLinkIsBusyWithWhatTheServerHasNotReceived) {
  round_trip_ = milliseconds(10);
  run(100, milliseconds(50));
  now_ += std::chrono::seconds(1);
  acknowledge_until(now_);
  EXPECT_LT(rate_.served_at(round_trip_), now_);
  EXPECT_FALSE(rate_.is_overdue(now_, round_trip_));
  const auto begin = now_;
  served_ = now_ + milliseconds(20);  // something else is in the link's queue
  write();
  write();
  EXPECT_NEAR(to_seconds(rate_.served_at(round_trip_) - begin), 0.080, 0.002);
  EXPECT_FALSE(rate_.is_overdue(begin + milliseconds(45), round_trip_));
  EXPECT_TRUE(rate_.is_overdue(begin + milliseconds(55), round_trip_));
  acknowledge_until(acks_.front().time);
  EXPECT_NEAR(to_seconds(rate_.served_at(round_trip_) - begin), 0.100, 0.006);
  EXPECT_FALSE(rate_.is_overdue(now_, round_trip_));
}

TEST_F(LinkRateTest, WithoutARateAFrameOnItsWayIsOverdue) {
  EXPECT_FALSE(rate_.is_overdue(now_, round_trip_));
  write();
  EXPECT_TRUE(rate_.is_overdue(now_, round_trip_));
}

TEST_F(LinkRateTest, OverALongRoundTripTheWindowGrowsToTheLinksRate) {
  round_trip_ = milliseconds(600);
  true_rate_ = 4e6;
  run(4000, milliseconds(1));
  expect_rate(4e6);
}

}  // namespace
}  // namespace orbbuf
