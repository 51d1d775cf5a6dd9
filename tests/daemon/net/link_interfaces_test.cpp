// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/link_interfaces.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

using namespace std::chrono_literals;

class LinkInterfacesTest : public testing::Test {
 protected:
  /// Probes that are all answered, until it is time to go back: how long that took.
  std::chrono::seconds time_to_return() {
    const auto begin = now_;
    for (bool is_time = false; !is_time;) {
      now_ += 1s;
      EXPECT_TRUE(interfaces_.is_probe_due(now_));
      interfaces_.on_probe(now_);
      EXPECT_FALSE(interfaces_.is_probe_due(now_));
      is_time = interfaces_.on_answer(now_);
    }
    return std::chrono::duration_cast<std::chrono::seconds>(now_ - begin);
  }
  void connect(const std::string& interface) { interfaces_.on_connected(interface, now_); }

  LinkInterfaces interfaces_{{"wlan0", "wwan0"}, 5s};
  LinkInterfaces::Time now_{1h};
};

TEST_F(LinkInterfacesTest, NoneIsOneOfTheKernelsChoiceWithoutProbes) {
  LinkInterfaces none({}, 5s);
  EXPECT_EQ(none.count(), 1U);
  EXPECT_EQ(none.next(), "");
  EXPECT_TRUE(none.is_round_begin());
  none.on_connected("", now_);
  EXPECT_FALSE(none.is_probe_due(now_ + 1h));
  none.on_stall();
  EXPECT_EQ(none.next(), "");
}

TEST_F(LinkInterfacesTest, EachHasItsTurnThePreferredOneFirst) {
  EXPECT_TRUE(interfaces_.is_round_begin());
  EXPECT_EQ(interfaces_.next(), "wlan0");
  EXPECT_FALSE(interfaces_.is_round_begin());
  EXPECT_EQ(interfaces_.next(), "wwan0");
  EXPECT_TRUE(interfaces_.is_round_begin());
  EXPECT_EQ(interfaces_.next(), "wlan0");
  interfaces_.start_over();
  EXPECT_EQ(interfaces_.next(), "wlan0");
}

TEST_F(LinkInterfacesTest, AfterAStallTheOtherIsFirst) {
  connect("wlan0");
  interfaces_.on_stall();
  EXPECT_TRUE(interfaces_.is_round_begin());
  EXPECT_EQ(interfaces_.next(), "wwan0");
  EXPECT_EQ(interfaces_.next(), "wlan0");
  connect("wwan0");
  interfaces_.on_stall();
  EXPECT_EQ(interfaces_.next(), "wlan0");
}

TEST_F(LinkInterfacesTest, ThePreferredOneIsNotProbedWhileItCarriesTheStream) {
  connect("wlan0");
  EXPECT_FALSE(interfaces_.is_probe_due(now_ + 1h));
}

TEST_F(LinkInterfacesTest, GoesBackWhenAllProbesOfTheTimeAreAnswered) {
  connect("wwan0");
  EXPECT_FALSE(interfaces_.is_probe_due(now_ + 900ms));
  EXPECT_EQ(time_to_return(), 6s);
}

TEST_F(LinkInterfacesTest, AProbeThatFailsOrIsUnansweredBeginsTheTimeAnew) {
  connect("wwan0");
  for (int i = 0; i < 4; ++i) {
    now_ += 1s;
    interfaces_.on_probe(now_);
    EXPECT_FALSE(interfaces_.on_answer(now_));
  }
  now_ += 1s;
  interfaces_.on_probe(now_);  // no answer until the next
  EXPECT_EQ(time_to_return(), 6s);
  interfaces_.on_probe_failed();
  EXPECT_EQ(time_to_return(), 6s);
}

TEST_F(LinkInterfacesTest, AReturnThatDoesNotLastMakesTheNextWaitTwiceAsLong) {
  connect("wwan0");
  for (const auto wait : {6s, 11s, 21s, 41s, 81s, 161s, 301s, 301s}) {
    EXPECT_EQ(time_to_return(), wait);
    connect("wlan0");
    now_ += 59s;
    connect("wwan0");
  }
  EXPECT_EQ(time_to_return(), 301s);
  connect("wlan0");
  now_ += 1min;
  connect("wwan0");
  EXPECT_EQ(time_to_return(), 6s);
}

TEST_F(LinkInterfacesTest, AReturnThatFailsMakesTheNextWaitTwiceAsLong) {
  connect("wwan0");
  EXPECT_EQ(time_to_return(), 6s);
  interfaces_.on_return_failed();
  EXPECT_EQ(time_to_return(), 11s);
}

TEST_F(LinkInterfacesTest, AWaitLongerThanTheLongestStays) {
  LinkInterfaces patient({"wlan0", "wwan0"}, 1h);
  patient.on_connected("wwan0", now_);
  patient.on_probe(now_);
  patient.on_answer(now_);
  patient.on_return_failed();
  patient.on_probe(now_);
  patient.on_answer(now_);
  EXPECT_FALSE(patient.on_answer(now_ + 1h - 1s));
  EXPECT_TRUE(patient.on_answer(now_ + 1h));
}

}  // namespace
}  // namespace orbbuf
