// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cstdlib>
#include <random>
#include <utility>
#include <vector>

#include "daemon/capture/stereo/stereo_source.hpp"

namespace orbbuf {
namespace {

using std::chrono::milliseconds;

constexpr std::int64_t kMillisecond = 1'000'000;

/// The times in ms of the pairs that came, and of nothing else.
using Pairs = std::vector<std::pair<std::int64_t, std::int64_t>>;

class StereoPairerTest : public testing::Test {
 protected:
  void add(Side side, std::int64_t time_ms) {
    RawFrame frame;
    frame.monotonic_ns = time_ms * kMillisecond;
    frame.capture_time_ns = side == Side::kLeft ? 1 : 2;
    const auto pair = pairer_.add(side, std::move(frame));
    if (!pair) return;
    ASSERT_TRUE(pair->right);
    EXPECT_EQ(pair->capture_time_ns, 1);
    EXPECT_EQ(pair->right->capture_time_ns, 2);
    EXPECT_EQ(pair->right->right, nullptr);
    pairs_.emplace_back(pair->monotonic_ns / kMillisecond,
                        pair->right->monotonic_ns / kMillisecond);
  }
  void left(std::int64_t time_ms) { add(Side::kLeft, time_ms); }
  void right(std::int64_t time_ms) { add(Side::kRight, time_ms); }
  void expect_unpaired(std::uint64_t left, std::uint64_t right) {
    EXPECT_EQ(pairer_.unpaired(Side::kLeft), left);
    EXPECT_EQ(pairer_.unpaired(Side::kRight), right);
  }

  StereoPairer pairer_{milliseconds(20)};
  Pairs pairs_;
};

TEST_F(StereoPairerTest, WhatWasCapturedTogetherIsAPairWhicheverComesFirst) {
  left(0);
  right(3);
  right(40);
  left(42);
  EXPECT_EQ(pairs_, (Pairs{{0, 3}, {42, 40}}));
  EXPECT_EQ(pairer_.pairs(), 2U);
  expect_unpaired(0, 0);
}

TEST_F(StereoPairerTest, TheToleranceIsThatFarAndNoFurther) {
  left(100);
  right(120);
  left(200);
  right(180);
  EXPECT_EQ(pairs_, (Pairs{{100, 120}, {200, 180}}));
  expect_unpaired(0, 0);
  left(300);
  right(321);
  expect_unpaired(1, 0);
  left(400);
  right(379);
  expect_unpaired(1, 2);
  EXPECT_EQ(pairs_.size(), 2U);
}

TEST_F(StereoPairerTest, AMissedFrameCostsOnlyItsPartner) {
  for (const int i : {0, 1, 3, 4}) left(40 * i);
  for (const int i : {0, 1, 2, 3, 4}) right(40 * i + 5);
  EXPECT_EQ(pairs_, (Pairs{{0, 5}, {40, 45}, {120, 125}, {160, 165}}));
  expect_unpaired(0, 1);
}

TEST_F(StereoPairerTest, OfTwoInReachTheNearerIsThePartner) {
  left(0);
  left(17);
  right(18);
  EXPECT_EQ(pairs_, (Pairs{{17, 18}}));
  expect_unpaired(1, 0);
}

TEST_F(StereoPairerTest, ACameraTwiceAsFastGivesEveryOtherFrame) {
  for (int i = 0; i < 10; ++i) {
    left(80 * i);
    right(80 * i + 1);
    right(80 * i + 41);
  }
  EXPECT_EQ(pairs_.size(), 10U);
  expect_unpaired(0, 9);  // the last one still waits
}

TEST_F(StereoPairerTest, WhileOneIsAwayTheOthersFramesDoNotPileUp) {
  const int most = StereoPairer::kMostWaiting;
  for (int i = 0; i < 1000; ++i) left(40 * i);
  expect_unpaired(static_cast<std::uint64_t>(1000 - most), 0);
  right(40 * 1000);  // back again, later than all that wait
  expect_unpaired(1000, 0);
  left(40 * 1000);
  EXPECT_EQ(pairs_, (Pairs{{40'000, 40'000}}));
}

TEST_F(StereoPairerTest, EveryFrameIsInOnePairGivenUpOrWaits) {
  std::mt19937 random(5);
  std::int64_t times_ms[2] = {0, 0};
  std::uint64_t added[2] = {0, 0};
  for (int i = 0; i < 100'000; ++i) {
    // Whichever is behind, most of the time; now and then one is missed, or a burst comes.
    auto side = static_cast<std::size_t>(times_ms[1] < times_ms[0]);
    if (random() % 8 == 0) side = 1 - side;
    times_ms[side] += 30 + random() % 21 + (random() % 50 == 0 ? 40 : 0);
    add(static_cast<Side>(side), times_ms[side]);
    ++added[side];
  }
  EXPECT_GT(pairs_.size(), 10'000U);
  for (const auto& [a, b] : pairs_) ASSERT_LE(std::abs(a - b), 20);
  for (std::size_t i = 1; i < pairs_.size(); ++i) {
    ASSERT_GT(pairs_[i].first, pairs_[i - 1].first);
    ASSERT_GT(pairs_[i].second, pairs_[i - 1].second);
  }
  std::uint64_t waiting = 0;
  for (const std::size_t side : {0U, 1U}) {
    waiting += added[side] - pairs_.size() - pairer_.unpaired(static_cast<Side>(side));
  }
  EXPECT_LE(waiting, StereoPairer::kMostWaiting);
}

}  // namespace
}  // namespace orbbuf
