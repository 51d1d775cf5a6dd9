// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/simulation.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "daemon/buffer/simple_policies.hpp"

namespace orbbuf::sim {
namespace {

using testing::ElementsAre;

constexpr std::int64_t kMs = 1'000'000;

/// A frame of 1000 bytes each 100 ms.
std::vector<FramePtr> frames(std::size_t count) {
  std::vector<FramePtr> frames;
  for (std::size_t i = 0; i < count; ++i) {
    EncodedFrame frame;
    frame.sequence = i;
    frame.capture_time_ns = static_cast<std::int64_t>(i) * 100 * kMs;
    frame.jpeg.assign(1000, 0);
    frames.push_back(std::make_shared<const EncodedFrame>(std::move(frame)));
  }
  return frames;
}

Delivery drop_oldest(std::size_t count, const LinkModel& link) {
  return simulate(frames(count), link, {{.frames = 3}, std::make_unique<DropOldestPolicy>()});
}

TEST(LinkModel, StandsStillDuringTheOutageOnly) {
  const LinkModel link{1000, 500 * kMs, 900 * kMs};
  EXPECT_EQ(link.finish(0, 100), 100 * kMs);
  EXPECT_EQ(link.finish(400 * kMs, 100), 500 * kMs);   // just through
  EXPECT_EQ(link.finish(450 * kMs, 100), 950 * kMs);   // half before, half after
  EXPECT_EQ(link.finish(600 * kMs, 100), 1000 * kMs);  // waits for the end
  EXPECT_EQ(link.finish(900 * kMs, 100), 1000 * kMs);
}

TEST(Simulation, AFastLinkDropsNothing) {
  const Delivery delivery = drop_oldest(4, {100'000, 0, 0});
  EXPECT_THAT(delivery.received, ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(delivery.drops_before, ElementsAre(0, 0, 0, 0));
  EXPECT_THAT(delivery.drops_after, ElementsAre(0, 0, 0, 0));
}

TEST(Simulation, AnOutageCostsWhatTheBufferCannotHold) {
  // 10 ms a frame. Frame 1 is on its way at 100 ms when the link goes; 2 to 7 meet a buffer of 3.
  const Delivery delivery = drop_oldest(10, {100'000, 105 * kMs, 750 * kMs});
  EXPECT_THAT(delivery.received, ElementsAre(0, 1, 5, 6, 7, 8, 9));
  EXPECT_THAT(delivery.drops_before, ElementsAre(0, 0, 3, 3, 3, 3, 3));
  EXPECT_THAT(delivery.drops_after, ElementsAre(0, 0, 0, 0, 0, 1, 2, 3, 3, 3));
}

TEST(Simulation, WhatWaitsAtTheEndIsStillDelivered) {
  const Delivery delivery = drop_oldest(3, {1000, 0, 0});  // a second a frame
  EXPECT_THAT(delivery.received, ElementsAre(0, 1, 2));
}

}  // namespace
}  // namespace orbbuf::sim
