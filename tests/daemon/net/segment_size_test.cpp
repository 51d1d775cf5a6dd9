// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "daemon/net/attempt_pace.hpp"

namespace orbbuf {
namespace {

constexpr std::uint64_t kHello = 300;

/// A connection that was welcome and stalled when so many bytes more had been acknowledged.
void stall_after(SegmentSize& size, std::uint64_t bytes) {
  size.on_welcome(kHello);
  size.on_stall(kHello + bytes);
}

TEST(SegmentSize, OrdinaryStallsChangeNothing) {
  SegmentSize size;
  for (int i = 0; i < 10; ++i) {
    stall_after(size, 1200);
    EXPECT_EQ(size.limit(), 0);
    stall_after(size, 100);  // an outage may begin just after a welcome
    EXPECT_EQ(size.limit(), 0);
  }
}

TEST(SegmentSize, IsLoweredWhileNothingLargeArrives) {
  SegmentSize size;
  stall_after(size, 0);
  stall_after(size, 1199);
  EXPECT_EQ(size.limit(), 1200);
  stall_after(size, 100);
  EXPECT_EQ(size.limit(), 536);
  stall_after(size, 100);
  EXPECT_EQ(size.limit(), 536);
}

TEST(SegmentSize, WhatWorksIsKeptUntilThePathChanges) {
  SegmentSize size;
  stall_after(size, 0);
  stall_after(size, 0);
  stall_after(size, 1'000'000);
  EXPECT_EQ(size.limit(), 1200);
  size.reset();
  EXPECT_EQ(size.limit(), 0);
}

TEST(SegmentSize, UnfinishedHandshakesCount) {
  SegmentSize size;
  size.on_nothing_large();
  EXPECT_EQ(size.limit(), 0);
  size.on_nothing_large();
  EXPECT_EQ(size.limit(), 1200);
}

}  // namespace
}  // namespace orbbuf
