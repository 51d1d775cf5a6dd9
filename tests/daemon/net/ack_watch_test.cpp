// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "daemon/net/stall_watch.hpp"

namespace orbbuf {
namespace {

using namespace std::chrono_literals;

class AckWatchTest : public testing::Test {
 protected:
  /// `after` the last look, with so many segments that the server's kernel has yet to take.
  bool is_silent(std::chrono::seconds after, std::uint32_t unacked = 0) {
    now_ += after;
    watch_.look(TcpProgress{0, unacked, 0, 0, 10ms}, now_);
    return watch_.is_silent();
  }
  void ack(Sequence next) { watch_.on_ack({{next, 0}, next}); }

  AckWatch watch_{60s};
  AckWatch::Time now_{};
};

TEST_F(AckWatchTest, FrameThatIsTakenAndNeverAcknowledgedIsSilence) {
  watch_.on_item(wire::kFrames, 7);
  EXPECT_FALSE(is_silent(1s));
  EXPECT_FALSE(is_silent(59s, 2)) << "a report is on its way, but the frame was taken";
  EXPECT_TRUE(is_silent(1s));
  EXPECT_EQ(watch_.silent_for(), 60s);
  watch_.restart();
  EXPECT_FALSE(is_silent(100s));
}

TEST_F(AckWatchTest, FrameOnASlowLinkIsNotTakenYet) {
  watch_.on_item(wire::kFrames, 7);
  for (int minute = 0; minute < 10; ++minute) EXPECT_FALSE(is_silent(60s, 1));
}

TEST_F(AckWatchTest, NothingIsOwedWithoutAFrame) {
  EXPECT_FALSE(is_silent(1000s));
  watch_.on_item(wire::kFrames, 7);
  EXPECT_FALSE(is_silent(1s));
  ack(8);
  EXPECT_FALSE(is_silent(1000s));
}

TEST_F(AckWatchTest, ItemsOfAnyStreamAreOwedToo) {
  for (const wire::StreamId stream : {wire::kDrops, wire::kLate, wire::kFirstOther}) {
    watch_.restart();
    watch_.on_item(stream, 7);
    EXPECT_FALSE(is_silent(1s));
    ack(8);
    EXPECT_FALSE(is_silent(1s)) << "of frames only";
    EXPECT_TRUE(is_silent(60s));
    wire::Ack ack;
    ack.position[stream] = 8;
    watch_.on_ack(ack);
    EXPECT_FALSE(is_silent(1000s));
  }
}

TEST_F(AckWatchTest, ServerThatRepeatsItsPositionIsHeldAndNotSilent) {
  watch_.on_item(wire::kFrames, 7);
  for (int i = 0; i < 10; ++i) {
    EXPECT_FALSE(is_silent(40s));
    ack(7);
  }
}

}  // namespace
}  // namespace orbbuf
