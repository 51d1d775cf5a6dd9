// SPDX-License-Identifier: Apache-2.0
#include "server/sink/losses.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "testing/captured_log.hpp"

namespace orbbuf {
namespace {

using testing::ElementsAre;

TEST(Losses, TheFirstAndTheLastAreLogged) {
  const test::CapturedLog log;
  {
    Losses losses("r s: dds");
    EXPECT_EQ(losses.count(), 0U);
    for (int i = 0; i < 3; ++i) losses.add("a reason");
    EXPECT_EQ(losses.count(), 3U);
  }
  EXPECT_THAT(log.lines(),
              ElementsAre("warning r s: dds: 1 frames of this session not published: a reason",
                          "warning r s: dds: 3 frames of this session not published: "
                          "the session is over"));
}

TEST(Losses, WhatIsLoggedIsNotLoggedAgain) {
  const test::CapturedLog log;
  { Losses("r s: dds").add("a reason"); }
  { const Losses none("r s: dds"); }
  EXPECT_EQ(log.lines().size(), 1U);
}

}  // namespace
}  // namespace orbbuf
