// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/link_rate.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstddef>
#include <deque>
#include <optional>
#include <vector>

#include "common/seconds.hpp"
#include "tests/daemon/net/modelled_link.hpp"

namespace orbbuf {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;

constexpr std::size_t kBytes = 40'000;

/// A link on a clock of its own: serves one frame after the other, and acknowledges each half a
/// round trip after it came.
class LinkRateTest : public testing::Test {
 protected:
  void write() { write(kBytes, true_rate_); }
  void write(std::size_t bytes, double rate) {
    const LinkRate::Time there = now_ + round_trip_ / 2;
    const auto service = nanoseconds(std::llround(1e9 * static_cast<double>(bytes) / rate));
    served_ = std::max(served_, there) + service;
    const LinkRate::Time ack = served_ + round_trip_ / 2 + beyond_;
    acks_.push_back({next_ + 1, acks_.empty() ? ack : std::max(ack, acks_.back().time)});
    rate_.on_written(now_, next_++, bytes);
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
      if (rate_.has_room(now_, round_trip_)) write();
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
  nanoseconds beyond_{0};  // what the path takes longer
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

TEST_F(LinkRateTest, BehindABrokenConnectionItIsAtMostThreeTimesWhatTheStreamCarried) {
  true_rate_ = 1e9;
  run(100, milliseconds(40));
  rate_.on_lost();
  expect_rate(3e6);
  rate_.on_lost();
  expect_rate(3e6);
}

TEST_F(LinkRateTest, ALinkThatFadesBeforeItBreaksIsNoSlowOneAfterwards) {
  true_rate_ = 2.5e6;
  run(200, milliseconds(40));
  true_rate_ = 5e4;
  run(50, milliseconds(40));
  EXPECT_LT(rate_.bytes_per_s(), 1e5);
  rate_.on_lost();
  EXPECT_GT(rate_.bytes_per_s(), 2e6);
}

TEST_F(LinkRateTest, OneThatWasSlowForLongIsSlowAfterwards) {
  true_rate_ = 2.5e6;
  run(200, milliseconds(40));
  true_rate_ = 5e4;
  run(500, milliseconds(40));
  rate_.on_lost();
  expect_rate(5e4);
}

/// Another stream in the queue, or a Wi-Fi card that sleeps. Frames are as large as the rate
/// allows.
TEST_F(LinkRateTest, WhatThePathUsuallyTakesLongerIsNoService) {
  true_rate_ = 2.5e6;
  round_trip_ = milliseconds(20);
  run(100, milliseconds(40));
  const auto run_as_planned = [&](int frames) {
    const Sequence before = next_;
    for (int i = 0; i < frames; ++i) {
      const double fits = rate_.bytes_per_s(now_, round_trip_) * 0.04;
      const auto bytes = static_cast<std::size_t>(std::clamp(fits, 0.25 * kBytes, 1.0 * kBytes));
      if (rate_.has_room(now_, round_trip_)) write(bytes, true_rate_);
      acknowledge_until(now_ + milliseconds(40));
    }
    return next_ - before;
  };
  for (const int beyond_ms : {50, 100, 200}) {
    beyond_ = milliseconds(beyond_ms);
    run_as_planned(500);
    EXPECT_GE(run_as_planned(250), 200U) << beyond_ms << " ms";
  }
  beyond_ = {};
  run_as_planned(250);
  true_rate_ = 4e5;  // and a link that becomes slow is seen as before
  run_as_planned(50);
  EXPECT_LT(rate_.bytes_per_s(), 5e5);
  EXPECT_GT(rate_.bytes_per_s(), 3e5);
}

/// Another frame is always on its way. Frames are as large as the rate allows.
TEST_F(LinkRateTest, NorIsTheJitterOfAWayOnWhichAnotherFrameAlwaysIs) {
  true_rate_ = 3e6;
  round_trip_ = milliseconds(200);
  double sum = 0;
  for (int i = 0; i < 1000; ++i) {
    beyond_ = milliseconds(i * i % 101);
    const double fits = rate_.bytes_per_s(now_, round_trip_) * 0.04;
    const double bytes = std::clamp(fits, 0.25 * kBytes, 0.75 * kBytes);
    const bool has_room = rate_.has_room(now_, round_trip_);
    if (has_room) write(static_cast<std::size_t>(bytes), true_rate_);
    acknowledge_until(now_ + milliseconds(40));
    if (has_room && i >= 500) sum += bytes;
  }
  EXPECT_GT(sum / 500, 0.6 * kBytes);
}

TEST_F(LinkRateTest, WhatAnIdleLinkPassesAtOnceIsNoRate) {
  run(3, milliseconds(40));
  rate_.on_lost();
  acks_.clear();
  now_ += std::chrono::seconds(2);
  for (int i = 0; i < 8; ++i) write(10'000, i < 3 ? 1e9 : true_rate_);
  acknowledge_until(now_ + std::chrono::seconds(1));
  EXPECT_LT(rate_.bytes_per_s(), 1.25e6);
  EXPECT_GT(rate_.bytes_per_s(), 0.75e6);
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

TEST_F(LinkRateTest, TwoSlowFramesInARowAreTheNewRate) {
  run(100, milliseconds(40));
  acknowledge_until(now_ + milliseconds(100));
  for (int i = 0; i < 2; ++i) write(kBytes, 1e5);
  acknowledge_until(acks_.back().time);
  expect_rate(1e5);
}

TEST_F(LinkRateTest, WhileAFrameIsSlowTheRateIsDoubtfulAndNoOtherIsWritten) {
  run(100, milliseconds(40));
  acknowledge_until(now_ + milliseconds(100));
  write(kBytes, 1e5);
  acknowledge_until(now_ + milliseconds(60));  // it should have taken 40 ms
  EXPECT_NEAR(rate_.bytes_per_s(now_, round_trip_), 1e6, 5e4);
  EXPECT_TRUE(rate_.has_room(now_, round_trip_));
  acknowledge_until(now_ + milliseconds(40));
  EXPECT_NEAR(rate_.bytes_per_s(now_, round_trip_), 5e5, 3e4);
  EXPECT_FALSE(rate_.has_room(now_, round_trip_));
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
    if (rate_.has_room(now_, round_trip_)) write();
  }
  EXPECT_EQ(acks_.size(), 2U);
}

TEST_F(LinkRateTest, BeyondTheTwoFramesIsWhatTakes30MsAndTwoRoundTrips) {
  true_rate_ = 16e6;  // 2.5 ms a frame
  run(1000, std::chrono::microseconds(200));
  EXPECT_NEAR(static_cast<double>(largest_window_), 12, 1);
  acknowledge_until(now_ + milliseconds(100));
  round_trip_ = milliseconds(50);
  run(3000, std::chrono::microseconds(200));
  EXPECT_NEAR(static_cast<double>(largest_window_), 52, 3);
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

/// A camera of 25 frames a second that has frames waiting behind an outage, so that the link is
/// never idle but for the window, and ModelledLink.
class Return {
 public:
  Return(const ModelledLink::Path& path, std::size_t frame_bytes)
      : path_(path), frame_bytes_(frame_bytes) {}

  /// Each frame is captured and sent at once.
  void live(double seconds) { run(seconds, 0.04); }
  void outage() {
    rate_.on_lost();
    ends_.clear();
    acks_.clear();
    received_ = written_;
    now_s_ += 2;
    link_.emplace(path_);
  }
  /// Each frame is sent when there is room for it.
  void catch_up(double seconds) {
    estimates_.clear();
    run(seconds, 0);
  }
  /// Of the true rate, once slow start has passed and the link has been busy for 100 ms.
  double highest() const { return *std::ranges::max_element(estimates_) / path_.bytes_per_s; }
  double lowest() const { return *std::ranges::min_element(estimates_) / path_.bytes_per_s; }

 private:
  static constexpr double kShownS = 0.1;
  static constexpr double kSlowStart = 8;     // round trips
  static constexpr std::size_t kUnsent = 11;  // segments: 16 KiB

  LinkRate::Time now() const {
    return LinkRate::Time(nanoseconds(std::llround(1e9 * (1 + now_s_))));
  }
  void run(double seconds, double interval_s) {
    const double begin_s = now_s_;
    const double shown_s = begin_s + kShownS + kSlowStart * path_.round_trip_s;
    double due_s = begin_s;
    const nanoseconds round_trip(std::llround(1e9 * path_.round_trip_s));
    for (; now_s_ < begin_s + seconds; now_s_ += ModelledLink::kStepS) {
      link_->step();
      for (; !ends_.empty() && ends_.front() <= link_->received(); ends_.pop_front()) {
        acks_.push_back(now_s_ + path_.round_trip_s / 2);
      }
      for (; !acks_.empty() && acks_.front() <= now_s_; acks_.pop_front()) {
        rate_.on_received(now(), ++received_, round_trip);
        if (now_s_ > shown_s) estimates_.push_back(rate_.bytes_per_s());
      }
      if (now_s_ < due_s || link_->unsent() > kUnsent || !rate_.has_room(now(), round_trip))
        continue;
      due_s = interval_s > 0 ? due_s + interval_s : now_s_;
      link_->write(frame_bytes_);
      ends_.push_back(link_->written());
      rate_.on_written(now(), written_++, frame_bytes_);
    }
  }

  const ModelledLink::Path path_;
  const std::size_t frame_bytes_;
  std::optional<ModelledLink> link_{path_};
  LinkRate rate_;
  double now_s_ = 0;
  std::deque<std::size_t> ends_;
  std::deque<double> acks_;
  Sequence written_ = 0;
  Sequence received_ = 0;
  std::vector<double> estimates_;
};

TEST(LinkRateAfterAReturn, IsNotTooHighWhateverTheQueueAndTheBurst) {
  for (const double need : {1.5, 2.5, 10.0}) {
    for (const double queue_s : {0.03, 0.1, 0.3, 1.0}) {
      for (const double burst : {5e3, 32e3}) {
        for (const double round_trip_s : {0.001, 0.01, 0.05}) {
          for (const std::size_t bytes : {12'000U, 40'000U}) {
            SCOPED_TRACE(testing::Message()
                         << need << " times the need, queue " << queue_s << " s, burst " << burst
                         << ", round trip " << round_trip_s << " s, frames of " << bytes);
            Return link({need * 25 * static_cast<double>(bytes), queue_s, burst, round_trip_s},
                        bytes);
            link.live(2);
            link.outage();
            link.catch_up(1);
            EXPECT_LT(link.highest(), 1.35);
            EXPECT_GT(link.lowest(), 0.4);
          }
        }
      }
    }
  }
}

}  // namespace
}  // namespace orbbuf
