// SPDX-License-Identifier: Apache-2.0
#include "daemon/buffer/send_planner.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

namespace orbbuf {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using std::chrono::seconds;

constexpr double kInterval = 0.04;
constexpr std::size_t kBytes = 40'000;
constexpr double kNeed = kBytes / kInterval;

/// A camera of 25 frames a second and a link, on a clock of their own. Frames are named by number.
class SendPlannerTest : public testing::Test {
 protected:
  /// The link sends at `rate` times the need from now on, and the planner is given `believed`.
  void run(double duration_s, double rate, std::optional<double> believed = {}) {
    const double end = now_ + duration_s;
    while (now_ < end) {
      capture_until(now_);
      if (waiting_.empty()) {
        if (is_ended_) return;
        now_ = static_cast<double>(captured_) * kInterval;
        continue;
      }
      const SendMoment moment{time(now_), believed.value_or(rate) * kNeed, end_};
      const std::size_t choice = planner_->choose(last_, waiting_, moment).front().index;
      planner_->on_sent(kBytes, moment);
      last_ = waiting_.at(choice).position_s;
      sent_.push_back(std::lround(*last_ / kInterval));
      lateness_.push_back(now_ - *last_);
      waiting_.erase(waiting_.begin(), waiting_.begin() + static_cast<std::ptrdiff_t>(choice) + 1);
      now_ += kInterval / rate;
    }
  }
  void outage(double duration_s) { now_ += duration_s; }

  void capture_until(double now) {
    while (static_cast<double>(captured_) * kInterval <= now + 1e-9) {
      if (is_ended_) return;
      planner_->on_captured(captured_ == 0 ? 0 : kInterval, {0, kBytes, 80});
      waiting_.push_back({static_cast<double>(captured_++) * kInterval, kBytes, 80});
    }
  }
  static nanoseconds time(double t) { return nanoseconds(std::llround(t * 1e9)); }

  /// Steps from frame to frame sent, in frames, from the one after `frame` on.
  std::vector<long> steps(long frame = 0) const {
    std::vector<long> steps;
    for (std::size_t k = 1; k < sent_.size(); ++k) {
      if (sent_[k - 1] >= frame) steps.push_back(sent_[k] - sent_[k - 1]);
    }
    return steps;
  }
  long largest_step() const { return std::ranges::max(steps()); }
  /// From `return_s` until a frame was sent that was the newest.
  double live_after(double return_s) const {
    for (std::size_t k = 0; k < sent_.size(); ++k) {
      const double t = static_cast<double>(sent_[k]) * kInterval + lateness_[k];
      if (t >= return_s - 1e-9 && lateness_[k] < kInterval) return t - return_s;
    }
    return INFINITY;
  }

  std::optional<SendPlanner> planner_{SendPlanner({seconds(1), seconds(10)})};
  double now_ = 0;
  long captured_ = 0;
  bool is_ended_ = false;
  std::optional<nanoseconds> end_;
  std::vector<PlannedFrame> waiting_;
  std::optional<double> last_;
  std::vector<long> sent_;
  std::vector<double> lateness_;
};

TEST_F(SendPlannerTest, NothingIsPassedOverWhileTheLinkKeepsUp) {
  run(10, 1.2);
  EXPECT_EQ(largest_step(), 1);
}

TEST_F(SendPlannerTest, AnOutageIsSpreadOverTheSendsUntilTheDeadline) {
  run(1, 1.5);
  outage(2);
  const double back = now_;
  run(3, 1.5);
  // 75 frames until live, of which 37 can be sent.
  EXPECT_LE(largest_step(), 3);
  EXPECT_LE(live_after(back), 1.0 + kInterval);
}

TEST_F(SendPlannerTest, AStepIsNeverLongerThanAllowedAndTheStreamIsLateInstead) {
  planner_.emplace(PlanSettings{seconds(1), milliseconds(160)});
  run(1, 1.5);
  outage(7);
  const double back = now_;
  run(8, 1.5);
  EXPECT_EQ(largest_step(), 4);
  EXPECT_GT(live_after(back), 1.0);
  EXPECT_LT(live_after(back), 3.0);
}

TEST_F(SendPlannerTest, AStreamThatWouldBeVeryLateMakesAStepAQuarterLonger) {
  planner_.emplace(PlanSettings{seconds(1), milliseconds(160)});
  run(1, 1.5);
  outage(20);
  const double back = now_;
  run(10, 1.5);
  EXPECT_EQ(largest_step(), 5);
  EXPECT_LT(live_after(back), 3.7);  // with steps of 4: 4.0 s or more
}

TEST_F(SendPlannerTest, ALinkTooSlowForGoodIsThinnedEvenlyAndStaysLive) {
  run(1, 1.5);
  run(60, 0.5);
  const auto taken = steps(50);
  EXPECT_LE(std::ranges::max(taken) - std::ranges::min(taken), 1);
  EXPECT_LE(std::ranges::max(lateness_), 1.0);
}

TEST_F(SendPlannerTest, ALinkOfAnyShareOfTheNeedIsThinnedToIt) {
  for (const double rate : {0.9, 0.7, 0.4, 0.3}) {
    run(20, rate);
    const std::size_t before = sent_.size();
    run(20, rate);
    const std::vector<double> late(lateness_.begin() + static_cast<std::ptrdiff_t>(before),
                                   lateness_.end());
    EXPECT_LE(std::ranges::max(late), 1.0) << rate;
    const auto taken = steps(sent_.at(before));
    EXPECT_LE(std::ranges::max(taken), std::ceil(1 / rate) + 1) << rate;
  }
}

TEST_F(SendPlannerTest, ARateBelievedTwiceTooHighCostsAtMostTwiceTheLateness) {
  run(1, 1.5, 3);
  outage(2);
  const double back = now_;
  run(4, 1.5, 3);
  EXPECT_LE(live_after(back), 2.0);
}

TEST_F(SendPlannerTest, ARateBelievedTwiceTooLowCostsStepsAndNoLateness) {
  run(1, 1.5, 0.75);
  outage(2);
  const double back = now_;
  run(4, 1.5, 0.75);
  EXPECT_LE(live_after(back), 1.0);
  EXPECT_LE(largest_step(), 6);
}

TEST_F(SendPlannerTest, AnotherOutageInTheMiddleIsPlannedForAnew) {
  run(1, 1.5);
  outage(2);
  run(0.5, 1.5);
  outage(2);
  const double back = now_;
  run(3, 1.5);
  EXPECT_LE(live_after(back), 1.0 + kInterval);
  EXPECT_LE(largest_step(), 4);
}

TEST_F(SendPlannerTest, AShortStallMakesNoLargeStep) {
  run(1, 1.5);
  for (int i = 0; i < 20; ++i) {
    outage(0.2);
    run(0.8, 1.5);
  }
  EXPECT_LE(largest_step(), 2);
}

TEST_F(SendPlannerTest, WhatWaitsAtTheEndIsSentWhole) {
  run(1, 1.5);
  outage(2);
  capture_until(now_);
  is_ended_ = true;
  end_ = time(now_ + 10);
  run(10, 1.5);
  EXPECT_EQ(largest_step(), 1);
  EXPECT_EQ(sent_.back(), captured_ - 1);
}

TEST_F(SendPlannerTest, WhatDoesNotFitBeforeTheEndIsThinned) {
  run(1, 1.5);
  outage(10);
  capture_until(now_);
  is_ended_ = true;
  const double end = now_ + 2;
  end_ = time(end);
  run(10, 1.5);
  EXPECT_EQ(sent_.back(), captured_ - 1);
  EXPECT_LE(largest_step(), 4);  // 250 frames, of which 75 can be sent
}

TEST_F(SendPlannerTest, TheFirstFrameOfAllIsNoOlderThanTheStreamMayBe) {
  now_ = 60;
  run(3, 1.5);
  EXPECT_EQ(sent_.front(), 59 * 25);
  EXPECT_EQ(largest_step(), 2);
}

TEST_F(SendPlannerTest, WithoutAKnownRateNothingIsPassedOver) {
  run(1, 1.5, 0);
  outage(1);
  run(1, 1.5, 0);
  EXPECT_EQ(largest_step(), 1);
}

TEST_F(SendPlannerTest, AHoleInWhatTheCameraGaveLoosensNoOtherStep) {
  run(1, 1.5);
  captured_ += 100;  // nothing comes for 4 s
  run(8, 1.5);
  auto taken = steps();
  std::ranges::sort(taken);
  EXPECT_EQ(taken.back(), 101);
  EXPECT_EQ(taken[taken.size() - 2], 1);
}
}  // namespace
}  // namespace orbbuf
