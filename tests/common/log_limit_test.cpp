// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "common/log.hpp"

namespace orbbuf {
namespace {

using namespace std::chrono_literals;

TEST(LogLimit, TheFirstIsLetThroughAndThenOneAnInterval) {
  LogLimit limit(10s);
  const LogLimit::Moment start{};
  EXPECT_TRUE(limit.lets_through(start));
  EXPECT_FALSE(limit.lets_through(start));
  EXPECT_FALSE(limit.lets_through(start + 9999ms));
  EXPECT_TRUE(limit.lets_through(start + 10s));
  EXPECT_FALSE(limit.lets_through(start + 11s));
  EXPECT_TRUE(limit.lets_through(start + 1h));
}

}  // namespace
}  // namespace orbbuf
