// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "daemon/net/backfill.hpp"

namespace orbbuf {
namespace {

using namespace std::chrono_literals;
using Time = BackfillPace::Time;

constexpr double kRate = 1e6;  // bytes a second: one in a microsecond

/// A camera of 25 frames a second, from `start_` on.
class BackfillPaceTest : public ::testing::Test {
 protected:
  BackfillPaceTest() {
    for (int i = 0; i < 10; ++i) capture();
  }
  /// Returns the time.
  Time capture(std::chrono::milliseconds after = 40ms) {
    now_ += after;
    pace_.on_captured(now_);
    return now_;
  }
  std::size_t bytes_at(std::chrono::microseconds later, double rate = kRate) const {
    return pace_.next(now_ + later, rate).bytes;
  }

  /// A part of a late frame.
  void write(std::size_t bytes) {
    pace_.on_written(now_, bytes, kRate);
    pace_.on_part_written();
  }

  Time now_{1h};
  BackfillPace pace_;
};

TEST_F(BackfillPaceTest, APartEndsBeforeTheNextFrameIsExpected) {
  EXPECT_EQ(bytes_at(0us), BackfillPace::kMostBytes);
  EXPECT_EQ(bytes_at(19'000us), BackfillPace::kMostBytes);
  EXPECT_NEAR(static_cast<double>(bytes_at(30'000us)), 6'000, 10);  // but for the guard
  EXPECT_NEAR(static_cast<double>(bytes_at(34'500us)), 1'500, 10);
  EXPECT_EQ(bytes_at(35'600us), 0U);  // 400 bytes are too few
  EXPECT_EQ(pace_.next(now_ + 35'600us, kRate).again, now_ + 80ms);
}

TEST_F(BackfillPaceTest, WhatWasWrittenKeepsTheLinkBusy) {
  write(30'000);
  EXPECT_EQ(bytes_at(0us), 0U);
  EXPECT_EQ(pace_.next(now_, kRate).again, now_ + 30ms);
  EXPECT_NEAR(static_cast<double>(bytes_at(29'000us)), 6'000, 10);  // behind it
  EXPECT_NEAR(static_cast<double>(bytes_at(31'000us)), 5'000, 10);
  write(30'000);
  EXPECT_EQ(bytes_at(35'000us), 0U);
  EXPECT_EQ(pace_.next(now_ + 35ms, kRate).again, now_ + 60ms);
}

/// As after a link that lost most of what was sent.
TEST_F(BackfillPaceTest, ARateThatWasFarTooLowCountsForASecond) {
  constexpr double kFarTooLow = 50;
  for (int i = 0; i < 25; ++i) pace_.on_written(capture(), 1'800, kFarTooLow);
  pace_.on_part_written();
  EXPECT_EQ(pace_.next(now_, kRate).again, now_ + 1s);
  for (int i = 0; i < 26; ++i) capture();
  EXPECT_EQ(bytes_at(0us), BackfillPace::kMostBytes);
}

/// Frames take longer than the time between them, all of them jitter. The measured rate cannot tell
/// that from a link that they fill.
TEST_F(BackfillPaceTest, ALinkThatSeemsToBeFullCarriesLateFramesToo) {
  constexpr std::size_t kLive = 2'500;
  constexpr double kSeeming = kLive / 0.05;
  std::size_t live = 0;
  std::size_t late = 0;
  for (int i = 0; i < 1000; ++i) {
    pace_.on_written(capture(), kLive, kSeeming);
    live += kLive;
    const auto bytes = pace_.next(now_, kSeeming, now_ + 100ms).bytes;
    if (bytes == 0) continue;
    pace_.on_written(now_, bytes, kSeeming);
    pace_.on_part_written();
    late += bytes;
  }
  EXPECT_GT(late, live / 50);
  EXPECT_LT(late, live / 30);
}

TEST_F(BackfillPaceTest, AnUnsteadyCameraIsGivenMoreTime) {
  for (int i = 0; i < 40; ++i) capture(i % 2 == 0 ? 36ms : 44ms);
  EXPECT_LT(bytes_at(30'000us), 3'000U);
  EXPECT_GT(bytes_at(20'000us), 9'000U);
}

TEST_F(BackfillPaceTest, WaitsWhileTheAcknowledgementsSayThatTheLinkIsBusy) {
  const auto turn = pace_.next(now_ + 10ms, kRate, now_ + 25ms);
  EXPECT_EQ(turn.bytes, 0U);
  EXPECT_EQ(turn.again, now_ + 25ms);
  EXPECT_EQ(pace_.next(now_ + 25ms, kRate, now_ + 25ms).bytes, bytes_at(25'000us));
}

TEST_F(BackfillPaceTest, WithoutLiveFramesOnlyTheLinkCounts) {
  EXPECT_EQ(bytes_at(81'000us), BackfillPace::kMostBytes);
  EXPECT_EQ(bytes_at(10'000'000us), BackfillPace::kMostBytes);
  pace_.on_written(now_ + 10s, 16'000, kRate);
  EXPECT_EQ(bytes_at(10'000'000us), 0U);
}

TEST_F(BackfillPaceTest, ALongPauseIsNotTakenForTheInterval) {
  capture(10s);
  EXPECT_LT(bytes_at(50'000us), 16'000U);
  for (int i = 0; i < 60; ++i) capture();
  EXPECT_NEAR(static_cast<double>(bytes_at(30'000us)), 6'000, 1'000);
}

TEST_F(BackfillPaceTest, AnUnknownRateIsTakenForALowOne) {
  EXPECT_NEAR(static_cast<double>(bytes_at(0us, 0)), 0.036 * BackfillPace::kUnknownRate, 10);
}

TEST(BackfillPaceOfNoCamera, ASlowLinkGetsSmallParts) {
  EXPECT_EQ(BackfillPace().next(Time(1h), 100).bytes, BackfillPace::kLeastBytes);
}

TEST(BackfillPaceOfNoCamera, BeginsAtOnce) {
  EXPECT_EQ(BackfillPace().next(Time(1h), kRate).bytes, BackfillPace::kMostBytes);
}

TEST(BackfillPaceOfNoCamera, AfterTheFirstFrameTheSecondOneIsAwaited) {
  BackfillPace pace;
  pace.on_captured(Time(1h));
  EXPECT_EQ(pace.next(Time(1h), kRate).bytes, 0U);
  EXPECT_EQ(pace.next(Time(1h), kRate).again, Time(1h) + 1s);
  EXPECT_EQ(pace.next(Time(1h) + 1s, kRate).bytes, BackfillPace::kMostBytes);
}

}  // namespace
}  // namespace orbbuf
