// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/attempt_pace.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

using namespace std::chrono_literals;

class AttemptPaceTest : public testing::Test {
 protected:
  AttemptPaceTest() { pace_.on_outage(now_); }

  /// Whether every one of many next attempts is `least` to 1.3 `least` after the last.
  void expect_interval(AttemptPace::Duration least) {
    auto shortest = AttemptPace::Duration::max();
    auto longest = AttemptPace::Duration::min();
    for (int i = 0; i < 1000; ++i) {
      pace_.on_attempt(now_);
      const auto interval = pace_.next(now_) - now_;
      shortest = std::min<AttemptPace::Duration>(shortest, interval);
      longest = std::max<AttemptPace::Duration>(longest, interval);
    }
    EXPECT_GE(shortest, least);
    EXPECT_LE(shortest, least * 1.02);
    EXPECT_LE(longest, least * 1.3);
    EXPECT_GE(longest, least * 1.28);
  }

  AttemptPace pace_{100ms, 8, 1};
  AttemptPace::Time now_{1h};
};

TEST_F(AttemptPaceTest, AttemptsNeverComeSoonerThanTheIntervalAndNeverAllAtOnce) {
  expect_interval(100ms);
}

TEST_F(AttemptPaceTest, AMinuteChangesNothingAndLongerOutagesSlowDownToASecond) {
  now_ += 60s;
  expect_interval(100ms);
  now_ += 240s;
  expect_interval(500ms);
  now_ += 24h;
  expect_interval(1s);
}

TEST_F(AttemptPaceTest, ANewOutageBeginsAtTheShortestInterval) {
  now_ += 1h;
  pace_.on_outage(now_);
  expect_interval(100ms);
}

TEST_F(AttemptPaceTest, EachOfTheAttemptsCanWaitForTwoRoundTrips) {
  pace_.on_round_trip(300ms);
  expect_interval(100ms);
  pace_.on_round_trip(700ms);
  expect_interval(200ms);
}

TEST_F(AttemptPaceTest, RefusalsSlowDownToTenSecondsUntilAWelcome) {
  pace_.on_refused(now_);
  expect_interval(200ms);
  pace_.on_refused(now_);
  expect_interval(400ms);
  for (int i = 0; i < 100; ++i) pace_.on_refused(now_);
  expect_interval(10s);
  pace_.on_welcome();
  expect_interval(100ms);
}

TEST_F(AttemptPaceTest, RefusalsDoNotSlowDownAttemptsElsewhere) {
  for (int i = 0; i < 5; ++i) pace_.on_refused(now_);
  EXPECT_GE(pace_.next_elsewhere(now_), now_ + 100ms);
  EXPECT_LE(pace_.next_elsewhere(now_), now_ + 130ms);
}

TEST_F(AttemptPaceTest, ARefusalCountsFromWhenItCame) {
  pace_.on_attempt(now_ - 5s);
  pace_.on_refused(now_);
  EXPECT_GE(pace_.next(now_), now_ + 200ms);
}

TEST_F(AttemptPaceTest, TheFirstAttemptComesWithinOneInterval) {
  pace_.on_attempt(now_ - 1s);
  auto last = now_;
  for (int i = 0; i < 1000; ++i) {
    const auto first = pace_.first(now_);
    EXPECT_GE(first, now_);
    EXPECT_LE(first, now_ + 100ms);
    last = std::max(last, first);
  }
  EXPECT_GE(last, now_ + 98ms);
}

TEST_F(AttemptPaceTest, NothingMakesAttemptsComeSoonerThanTheInterval) {
  pace_.on_attempt(now_);
  EXPECT_GE(pace_.first(now_), now_ + 100ms);
  EXPECT_EQ(pace_.soonest(), now_ + 100ms);
}

}  // namespace
}  // namespace orbbuf
