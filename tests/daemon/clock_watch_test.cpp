// SPDX-License-Identifier: Apache-2.0
#include "daemon/clock_watch.hpp"

#include <gtest/gtest.h>

#include "testing/captured_log.hpp"

namespace orbbuf {
namespace {

using std::chrono::milliseconds;
using std::chrono::nanoseconds;
using std::chrono::seconds;

class ClockWatchTest : public testing::Test {
 protected:
  /// A second passes, and the clock is set by `step` besides.
  void look(nanoseconds step = {}) {
    now_.since_boot += seconds(1);
    now_.wall += seconds(1) + std::chrono::duration_cast<std::chrono::system_clock::duration>(step);
    watch_.look(now_);
  }

  const test::CapturedLog log_;
  SystemClockReading now_{{}, seconds(20), false};
  ClockWatch watch_;
};

TEST_F(ClockWatchTest, WarnsOnceOfAClockThatIsNotSynchronised) {
  look();
  look();
  EXPECT_EQ(log_.lines("no NTP client keeps this machine's clock").size(), 1U);
  now_.is_synchronised = true;
  look();
  look();
  EXPECT_EQ(log_.lines("an NTP client keeps this machine's clock now").size(), 1U);
}

TEST_F(ClockWatchTest, ASynchronisedClockNeedsNoWords) {
  now_.is_synchronised = true;
  look();
  look(milliseconds(400));
  look(milliseconds(-400));
  EXPECT_TRUE(log_.lines("clock").empty());
}

TEST_F(ClockWatchTest, SamplesHaveTheClockOfTheFrames) {
  const auto wall = [this] {
    return std::chrono::nanoseconds(now_.wall.time_since_epoch()).count();
  };
  look();
  EXPECT_EQ(watch_.session_time(wall() + 5), wall() + 5);
  look(seconds(3600));
  EXPECT_EQ(watch_.session_time(wall() - 5), wall() - 5 - nanoseconds(seconds(3600)).count());
  const auto stamped_before = wall() - 5;
  look(seconds(-7200));
  const auto session = wall() + nanoseconds(seconds(3600)).count();
  EXPECT_EQ(watch_.session_time(wall()), session);
  EXPECT_EQ(watch_.session_time(stamped_before), session) << "not of the future";
  EXPECT_EQ(watch_.session_time(wall() + 9), session + 9) << "a driver's clock is ahead";
  watch_.begin_session();
  EXPECT_EQ(watch_.session_time(wall()), wall());
}

TEST_F(ClockWatchTest, SaysWhatIsToBeAddedToTheTimesOfASession) {
  now_.is_synchronised = true;
  look();
  look(seconds(60));
  EXPECT_EQ(log_.lines("the clock was set by +60.000 s").size(), 1U);
  EXPECT_TRUE(log_.lines("add").empty()) << "it has not begun";
  watch_.begin_session();
  look(seconds(3600));
  EXPECT_EQ(log_.lines("the clock was set by +3600.000 s").size(), 1U);
  look(milliseconds(-500));
  EXPECT_EQ(log_.lines("the clock was set by -0.500 s").size(), 1U);
  EXPECT_EQ(log_.lines("add +3599.500 s").size(), 1U);
  EXPECT_EQ(watch_.stepped(), milliseconds(3'599'500));
}

}  // namespace
}  // namespace orbbuf
