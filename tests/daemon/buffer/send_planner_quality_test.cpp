// SPDX-License-Identifier: Apache-2.0
// SendPlanner with a range of qualities: which quality it chooses, and what new frames are encoded
// at.
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <optional>
#include <vector>

#include "daemon/buffer/send_planner.hpp"

namespace orbbuf {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using std::chrono::seconds;

constexpr double kInterval = 0.04;
constexpr double kBytes = 40'000;  // at quality 80
constexpr double kNeed = kBytes / kInterval;

/// A scene whose JPEGs are a little smaller at low qualities than the planner thinks at first.
double bytes_at(int quality) {
  const double step = quality < 50 ? 50.0 / quality : 2 - quality / 50.0;
  return kBytes * std::pow(step / 0.4, -0.65);
}

struct Sent {
  long number;
  int quality;
  double late_s;
};

/// A camera of 25 frames a second and a link, on a clock of their own.
class SendPlannerQualityTest : public testing::Test {
 protected:
  /// The link carries `rate` times the need of quality 80 from now on.
  void run(double duration_s, double rate) {
    const double end = now_ + duration_s;
    while (now_ < end) {
      capture_until(now_);
      if (waiting_.empty()) {
        now_ = static_cast<double>(captured_) * kInterval;
        continue;
      }
      send(rate);
    }
  }
  void outage(double duration_s) { now_ += duration_s; }

  std::vector<Sent> sent_from(double time_s) const {
    std::vector<Sent> sent = sent_;
    std::erase_if(sent, [&](const Sent& one) {
      return static_cast<double>(one.number) * kInterval + one.late_s < time_s - 1e-9;
    });
    return sent;
  }
  static long largest_step(const std::vector<Sent>& sent) {
    long largest = 0;
    for (std::size_t k = 1; k < sent.size(); ++k) {
      largest = std::max(largest, sent[k].number - sent[k - 1].number);
    }
    return largest;
  }
  double live_after(double return_s) const {
    for (const Sent& one : sent_from(return_s)) {
      const double time_s = static_cast<double>(one.number) * kInterval + one.late_s;
      if (one.late_s < kInterval) return time_s - return_s;
    }
    return INFINITY;
  }
  static int least_quality(const std::vector<Sent>& sent) {
    return std::ranges::min(sent, {}, &Sent::quality).quality;
  }

  std::optional<SendPlanner> planner_{SendPlanner({seconds(1), seconds(10), 80, 20})};
  double now_ = 0;
  bool is_encoder_ours_ = true;  // else the camera's, which does not change its quality

 private:
  static nanoseconds time(double t) { return nanoseconds(std::llround(t * 1e9)); }
  void capture_until(double now) {
    while (static_cast<double>(captured_) * kInterval <= now + 1e-9) {
      const int quality = is_encoder_ours_ ? planner_->encode_quality() : 80;
      const PlannedFrame frame{static_cast<double>(captured_) * kInterval,
                               static_cast<std::size_t>(bytes_at(quality)), quality};
      planner_->on_captured(captured_++ == 0 ? 0 : kInterval, frame);
      waiting_.push_back(frame);
    }
  }
  void send(double rate) {
    const SendMoment moment{time(now_), rate * kNeed};
    const auto choice = planner_->choose(last_, waiting_, moment).front();
    const PlannedFrame frame = waiting_.at(choice.index);
    const int quality = choice.quality == 0 ? frame.quality : choice.quality;
    EXPECT_LE(quality, frame.quality);
    const auto bytes = static_cast<std::size_t>(bytes_at(quality));
    if (choice.quality > 0) planner_->on_reduced(frame, bytes, quality);
    planner_->on_sent(bytes, moment);
    last_ = frame.position_s;
    sent_.push_back({std::lround(*last_ / kInterval), quality, now_ - *last_});
    waiting_.erase(waiting_.begin(),
                   waiting_.begin() + static_cast<std::ptrdiff_t>(choice.index) + 1);
    now_ += static_cast<double>(bytes) / (rate * kNeed);
  }

  long captured_ = 0;
  std::vector<PlannedFrame> waiting_;
  std::optional<double> last_;
  std::vector<Sent> sent_;
};

TEST_F(SendPlannerQualityTest, AFrameGoesAsItIsWhileTheLinkKeepsUp) {
  run(10, 1.2);
  EXPECT_EQ(least_quality(sent_from(0)), 80);
}

TEST_F(SendPlannerQualityTest, EveryFrameOfAShortOutageIsSentAndInTime) {
  run(2, 1.5);
  outage(1);
  const double back = now_;
  run(4, 1.5);
  const auto sent = sent_from(back);
  EXPECT_EQ(largest_step(sent), 1);
  EXPECT_LE(live_after(back), 1 + kInterval);
  EXPECT_LT(least_quality(sent), 80);
  EXPECT_EQ(sent.back().quality, 80);
}

TEST_F(SendPlannerQualityTest, AShorterOutageCostsLessQuality) {
  int last = 0;
  for (const double outage_s : {2.0, 1.0, 0.5, 0.2}) {
    run(4, 1.5);
    outage(outage_s);
    const double back = now_;
    run(4, 1.5);
    const auto sent = sent_from(back);
    const double sum = std::accumulate(sent.begin(), sent.begin() + 10, 0.0,
                                       [](double s, const Sent& one) { return s + one.quality; });
    EXPECT_GT(static_cast<int>(sum), last) << outage_s;
    last = static_cast<int>(sum);
  }
}

TEST_F(SendPlannerQualityTest, ALongOutageIsThinnedAtALowQualityAndInTime) {
  run(2, 1.5);
  outage(10);
  const double back = now_;
  run(0.8, 1.5);
  const auto sent = sent_from(back);
  run(3, 1.5);
  EXPECT_LE(std::ranges::max(sent, {}, &Sent::quality).quality, 40);
  // 275 frames, and what is 37 at quality 80 and some 120 at 20.
  EXPECT_LE(largest_step(sent), 3);
  EXPECT_LE(live_after(back), 1 + kInterval);
}

TEST_F(SendPlannerQualityTest, TheSameOutageHasLongerStepsWithoutARange) {
  planner_.emplace(PlanSettings{seconds(1), seconds(10), 80, 80});
  run(2, 1.5);
  outage(10);
  const double back = now_;
  run(4, 1.5);
  EXPECT_GE(largest_step(sent_from(back)), 7);
  EXPECT_EQ(least_quality(sent_from(0)), 80);
}

TEST_F(SendPlannerQualityTest, TheStepIsNeverLongerThanAllowedAndTheStreamIsLateInstead) {
  planner_.emplace(PlanSettings{seconds(1), milliseconds(80), 80, 20});
  run(2, 1.5);
  outage(20);
  const double back = now_;
  run(6, 1.5);
  EXPECT_EQ(largest_step(sent_from(back)), 2);
  EXPECT_GT(live_after(back), 1);
}

TEST_F(SendPlannerQualityTest, AQualityOfItsOwnThatIsLowerIsNotRaised) {
  planner_.emplace(PlanSettings{seconds(1), seconds(10), 80, 20});
  const std::vector<PlannedFrame> waiting = {{0.04, 9000, 15}, {0.08, 9000, 15}};
  planner_->on_captured(0.04, waiting[0]);
  const auto choices = planner_->choose(0, waiting, {milliseconds(100), 1000});
  EXPECT_EQ(choices.front().quality, 0);
}

TEST_F(SendPlannerQualityTest, AFrameOfUnknownQualityCountsAsEncodedByThisProgram) {
  const std::vector<PlannedFrame> waiting = {{0.04, 40'000, 0}};
  planner_->on_captured(0.04, waiting[0]);
  planner_->on_captured(0.04, waiting[0]);
  const auto choices = planner_->choose(0, waiting, {milliseconds(100), kNeed / 2});
  EXPECT_GT(choices.front().quality, 20);
  EXPECT_LT(choices.front().quality, 50);
}

TEST_F(SendPlannerQualityTest, ALinkThatIsTooSlowForGoodGetsFramesThatAreEncodedForIt) {
  run(2, 1.5);
  run(5, 0.5);
  const double settled = now_;
  run(60, 0.5);
  const auto sent = sent_from(settled);
  EXPECT_EQ(largest_step(sent), 1);
  EXPECT_LE(std::ranges::max(sent, {}, &Sent::late_s).late_s, 3 * kInterval);
  EXPECT_LT(planner_->encode_quality(), 40);
  EXPECT_GT(planner_->encode_quality(), 25);
  const auto [least, most] = std::ranges::minmax_element(sent, {}, &Sent::quality);
  EXPECT_LE(most->quality - least->quality, 5);
}

TEST_F(SendPlannerQualityTest,
       ALinkThatCannotCarryEachFrameAtTheLeastQualityIsThinnedWithoutBeingLate) {
  is_encoder_ours_ = false;
  run(2, 1.5);
  const double slow = now_;
  run(20, 0.22);  // a frame at the least quality takes 1.4 intervals
  const auto sent = sent_from(slow + 1);
  EXPECT_EQ(largest_step(sent), 2);
  EXPECT_LE(std::ranges::max(sent, {}, &Sent::late_s).late_s, 0.16);
}

TEST_F(SendPlannerQualityTest, TheEncodedQualityComesBackWithTheLink) {
  run(10, 0.5);
  ASSERT_LT(planner_->encode_quality(), 50);
  run(2, 1.5);
  EXPECT_LT(planner_->encode_quality(), 50);  // not at once
  run(10, 1.5);
  EXPECT_EQ(planner_->encode_quality(), 80);
}

TEST_F(SendPlannerQualityTest, AnOutageDoesNotLowerTheEncodedQuality) {
  run(2, 1.5);
  for (const double outage_s : {0.3, 2.0, 10.0}) {
    outage(outage_s);
    run(4, 1.5);
    EXPECT_EQ(planner_->encode_quality(), 80) << outage_s;
  }
}

TEST_F(SendPlannerQualityTest, LooksAheadWithoutAChangeOfItsOwn) {
  run(2, 1.5);
  std::vector<PlannedFrame> waiting;
  for (int i = 1; i <= 100; ++i) waiting.push_back({now_ + i * kInterval, 40'000, 80});
  const SendMoment moment{nanoseconds(std::llround((now_ + 4) * 1e9)), 1.5 * kNeed};
  const auto ahead = planner_->look_ahead(now_, waiting, moment);
  ASSERT_EQ(ahead.size(), 3U);
  EXPECT_LT(ahead[0].index, ahead[1].index);
  EXPECT_LT(ahead[1].index, ahead[2].index);
  const auto again = planner_->look_ahead(now_, waiting, moment);
  EXPECT_TRUE(std::ranges::equal(again, ahead));
  EXPECT_TRUE(std::ranges::equal(planner_->choose(now_, waiting, moment), ahead));
}

}  // namespace
}  // namespace orbbuf
