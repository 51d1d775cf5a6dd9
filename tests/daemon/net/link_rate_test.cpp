// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/link_rate.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

using namespace std::chrono_literals;
using std::chrono::nanoseconds;

constexpr std::size_t kBytes = 40'000;

class LinkRateTest : public testing::Test {
 protected:
  /// A frame is written as soon as the one before it is acknowledged, and acknowledged `service`
  /// and a round trip later.
  void serve(nanoseconds service, std::size_t bytes = kBytes) {
    rate_.on_write(next_, bytes, now_);
    now_ += kRoundTrip + service;
    rate_.on_acknowledged(++next_, now_, kRoundTrip);
  }
  void serve_many(int frames, nanoseconds service) {
    while (frames-- > 0) serve(service);
  }

  static constexpr nanoseconds kRoundTrip = 10ms;
  LinkRate rate_;
  LinkRate::Time now_{1h};
  Sequence next_ = 0;
};

TEST_F(LinkRateTest, IsUnknownUntilTheFirstAcknowledgement) {
  rate_.on_connected(now_);
  rate_.on_write(0, kBytes, now_);
  EXPECT_EQ(rate_.bytes_per_s(), 0);
  rate_.on_acknowledged(0, now_ + 1s, kRoundTrip);
  EXPECT_EQ(rate_.bytes_per_s(), 0);
  rate_.on_acknowledged(1, now_ + kRoundTrip + 20ms, kRoundTrip);
  EXPECT_NEAR(rate_.bytes_per_s(), 2e6, 1);
}

TEST_F(LinkRateTest, CountsWhatIsInFlight) {
  for (Sequence sequence = 0; sequence < 4; ++sequence) rate_.on_write(sequence, 10, now_);
  EXPECT_EQ(rate_.frames_in_flight(), 4U);
  EXPECT_EQ(rate_.bytes_in_flight(), 40U);
  rate_.on_acknowledged(3, now_ + 1s, kRoundTrip);
  EXPECT_EQ(rate_.frames_in_flight(), 1U);
  EXPECT_EQ(rate_.bytes_in_flight(), 10U);
  rate_.on_connected(now_ + 1s);
  EXPECT_EQ(rate_.frames_in_flight(), 0U);
  EXPECT_EQ(rate_.bytes_in_flight(), 0U);
}

TEST_F(LinkRateTest, NeitherRoundTripNorIdleTimeCounts) {
  for (int frame = 0; frame < 20; ++frame) {
    serve(5ms);
    now_ += 700ms;
  }
  EXPECT_NEAR(rate_.bytes_per_s(), 8e6, 1);
}

TEST_F(LinkRateTest, FramesOfOneAcknowledgementCountTogether) {
  serve(5ms);
  for (int frame = 0; frame < 30; frame += 3) {
    for (int i = 0; i < 3; ++i) rate_.on_write(next_ + static_cast<Sequence>(i), kBytes, now_);
    now_ += kRoundTrip + 15ms;
    rate_.on_acknowledged(next_ += 3, now_, kRoundTrip);
  }
  EXPECT_NEAR(rate_.bytes_per_s(), 8e6, 1);
}

TEST_F(LinkRateTest, AnAcknowledgementSoonerThanARoundTripIsNoInfiniteRate) {
  rate_.on_write(0, kBytes, now_);
  rate_.on_acknowledged(1, now_ + 1ms, kRoundTrip);
  EXPECT_NEAR(rate_.bytes_per_s(), 1e9, 1);
}

TEST_F(LinkRateTest, StutterIsAveraged) {
  serve_many(100, 5ms);
  for (int frame = 0; frame < 200; ++frame) serve(frame % 5 == 4 ? 15ms : 5ms);
  EXPECT_NEAR(rate_.bytes_per_s(), 40e3 / 7e-3, 0.1 * 40e3 / 7e-3);
}

TEST_F(LinkRateTest, AnOutageHardlyChangesTheRate) {
  serve_many(100, 5ms);
  serve(30s);
  EXPECT_GT(rate_.bytes_per_s(), 0.8 * 8e6);
  serve_many(50, 5ms);
  EXPECT_GT(rate_.bytes_per_s(), 0.95 * 8e6);
}

TEST_F(LinkRateTest, ALinkThatStaysSlowIsFoundOutWithinSeconds) {
  serve_many(1000, 5ms);
  serve_many(40, 50ms);
  EXPECT_LT(rate_.bytes_per_s(), 1.2 * 8e5);
  serve_many(1000, 5ms);
  serve_many(12, 500ms);
  EXPECT_LT(rate_.bytes_per_s(), 1.5 * 8e4) << "a hundredth of the rate";
}

TEST_F(LinkRateTest, ALinkThatBecomesFastIsFoundOut) {
  serve_many(20, 500ms);
  serve_many(60, 50ms);
  EXPECT_GT(rate_.bytes_per_s(), 0.8 * 8e5);
}

TEST_F(LinkRateTest, ANewConnectionKeepsTheRateAndForgetsWhatWasInFlight) {
  rate_.on_connected(now_);
  serve_many(100, 5ms);
  rate_.on_write(next_, kBytes, now_);
  rate_.on_write(next_ + 1, kBytes, now_);
  now_ += 1min;
  rate_.on_connected(now_);
  rate_.on_acknowledged(next_ + 2, now_, kRoundTrip);
  EXPECT_NEAR(rate_.bytes_per_s(), 8e6, 1);
}

TEST_F(LinkRateTest, SlowStartDoesNotLowerTheRate) {
  serve_many(100, 5ms);
  rate_.on_connected(now_);
  for (const nanoseconds service : {30ms, 20ms, 10ms}) serve(service);
  EXPECT_NEAR(rate_.bytes_per_s(), 8e6, 1);
  serve_many(20, 2500us);
  EXPECT_GT(rate_.bytes_per_s(), 8e6) << "but what is faster counts";
}

TEST_F(LinkRateTest, ANewConnectionOnASlowerLinkIsFoundOut) {
  serve_many(100, 5ms);
  rate_.on_connected(now_);
  serve_many(42, 50ms);
  EXPECT_LT(rate_.bytes_per_s(), 1.2 * 8e5);
}

/// A link that is never idle, with so many bytes a second: the window of frames is always full.
class BusyLinkRateTest : public testing::TestWithParam<double> {};

TEST_P(BusyLinkRateTest, IsMeasured) {
  LinkRate rate;
  LinkRate::Time now{1h};
  Sequence written = 0;
  rate.on_connected(now);
  for (Sequence next = 0; next < 200;) {
    while (written < next + 3) rate.on_write(written++, kBytes, now);
    now +=
        std::chrono::duration_cast<nanoseconds>(std::chrono::duration<double>(kBytes / GetParam()));
    rate.on_acknowledged(++next, now, {});
  }
  EXPECT_NEAR(rate.bytes_per_s(), GetParam(), 0.02 * GetParam());
}

INSTANTIATE_TEST_SUITE_P(From10KilobytesTo1Gigabyte, BusyLinkRateTest,
                         testing::Values(1e4, 1e5, 1e6, 1e7, 1e8, 1e9));

}  // namespace
}  // namespace orbbuf
