// SPDX-License-Identifier: Apache-2.0
#include "bench/sim/simulation.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <utility>
#include <vector>

#include "daemon/buffer/simple_policies.hpp"

namespace orbbuf::sim {
namespace {

using namespace std::chrono_literals;
using testing::ElementsAre;

constexpr std::int64_t kMs = 1'000'000;

/// A frame of 1000 bytes each 100 ms.
std::vector<FramePtr> frames(std::size_t count) {
  std::vector<FramePtr> frames;
  for (std::size_t i = 0; i < count; ++i) {
    EncodedFrame frame;
    frame.sequence = i;
    frame.capture_time_ns = static_cast<std::int64_t>(i) * 100 * kMs;
    frame.quality = 80;
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

/// The planner with a range of qualities; at quality 40 a frame has half of its bytes.
Delivery reduce(std::size_t count, const LinkModel& link, bool may_reduce) {
  SimulatedBuffer buffer{{}, std::make_unique<DropOldestPolicy>()};
  buffer.planner = std::make_unique<SendPlanner>(
      PlanSettings{500ms, std::chrono::seconds(100), 80, may_reduce ? 20 : 80});
  buffer.reduced_bytes = buffer.encoded_bytes = [](std::size_t, int quality) {
    return static_cast<std::size_t>(1000 * quality / 80);
  };
  return simulate(frames(count), link, std::move(buffer));
}

TEST(Simulation, FramesThatWaitAreMadeSmaller) {
  const LinkModel link{20'000, 3000 * kMs, 4000 * kMs};
  const Delivery reduced = reduce(100, link, true);
  EXPECT_EQ(reduced.received.size(), 100U);
  const auto first = std::ranges::lower_bound(reduced.begin_ns, link.outage_end_ns);
  const auto k = static_cast<std::size_t>(first - reduced.begin_ns.begin());
  EXPECT_LT(reduced.quality.at(k), 80);
  EXPECT_EQ(reduced.bytes.at(k), static_cast<std::size_t>(1000 * reduced.quality.at(k) / 80));
  EXPECT_EQ(reduced.quality.back(), 80);
  EXPECT_LT(reduce(100, link, false).received.size(), 100U);
}

TEST(Simulation, ALinkThatIsTooSlowGetsFramesThatAreEncodedForIt) {
  const Delivery delivery = reduce(300, {6'000, 0, 0}, true);
  EXPECT_GE(delivery.received.size(), 299U);
  EXPECT_LT(delivery.quality.back(), 50);
}

TEST(Simulation, RecordsWhenEachSendBeganAndEnded) {
  const Delivery delivery = drop_oldest(10, {100'000, 105 * kMs, 750 * kMs});
  EXPECT_THAT(delivery.begin_ns,
              ElementsAre(0, 100 * kMs, 755 * kMs, 765 * kMs, 775 * kMs, 800 * kMs, 900 * kMs));
  EXPECT_THAT(delivery.end_ns, ElementsAre(10 * kMs, 755 * kMs, 765 * kMs, 775 * kMs, 785 * kMs,
                                           810 * kMs, 910 * kMs));
}

/// A planner that has the whole of a bad link's time to catch up in, and no bound on its step.
SimulatedBuffer planner(std::chrono::nanoseconds live_again) {
  SimulatedBuffer buffer{{}, std::make_unique<DropOldestPolicy>()};
  buffer.planner =
      std::make_unique<SendPlanner>(PlanSettings{live_again, std::chrono::seconds(100)});
  return buffer;
}

/// From the outage's end until a send begins with the newest frame.
double live_again_s(const Delivery& delivery, std::int64_t outage_end_ns) {
  for (std::size_t k = 0; k < delivery.received.size(); ++k) {
    const auto next_ns = static_cast<std::int64_t>(delivery.received[k] + 1) * 100 * kMs;
    if (delivery.begin_ns[k] < outage_end_ns || next_ns < delivery.begin_ns[k]) continue;
    return 1e-9 * static_cast<double>(delivery.begin_ns[k] - outage_end_ns);
  }
  return std::numeric_limits<double>::infinity();
}

TEST(Simulation, ThePlannerKnowsTheRateAndTheTimeOfEachSend) {
  // It may be a fifth later rather than make a longer step, and the last frame is begun then.
  const LinkModel link{20'000, 1020 * kMs, 3000 * kMs};  // 50 ms a frame
  const double soon_s = live_again_s(simulate(frames(100), link, planner(500ms)), 3000 * kMs);
  const double later_s = live_again_s(simulate(frames(100), link, planner(1000ms)), 3000 * kMs);
  EXPECT_LE(soon_s, 0.65);
  EXPECT_GT(later_s, soon_s);
  EXPECT_LE(later_s, 1.25);
}

TEST(Simulation, WhatThePlannerBelievesOfTheRateCountsNotTheTruth) {
  const LinkModel link{20'000, 1020 * kMs, 3000 * kMs};
  SimulatedBuffer hopeful = planner(500ms);
  hopeful.believed_rate = 4;
  EXPECT_GT(live_again_s(simulate(frames(100), link, std::move(hopeful)), 3000 * kMs),
            live_again_s(simulate(frames(100), link, planner(500ms)), 3000 * kMs));
}

TEST(Simulation, StandInsArePushedInPlaceOfTheFrames) {
  // On their clock the first half of the outage goes ten times as far as the second.
  const std::vector<FramePtr> all = frames(40);
  std::vector<FramePtr> stand_ins;
  std::int64_t time_ns = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    EncodedFrame frame = *all[i];
    frame.capture_time_ns = time_ns;
    time_ns += (i < 20 ? 190 : 10) * kMs;
    stand_ins.push_back(std::make_shared<const EncodedFrame>(std::move(frame)));
  }
  SimulatedBuffer buffer = planner(500ms);
  buffer.stand_ins = &stand_ins;
  const Delivery delivery =
      simulate(all, LinkModel{20'000, 1020 * kMs, 3000 * kMs}, std::move(buffer));
  const auto sent_of = [&](std::size_t first, std::size_t last) {
    return std::ranges::count_if(delivery.received,
                                 [&](std::size_t i) { return i >= first && i < last; });
  };
  EXPECT_GT(sent_of(10, 20), sent_of(20, 30));
}

TEST(Simulation, AFrameThatIsNotAdmittedIsDropped) {
  SimulatedBuffer buffer{{.frames = 3}, std::make_unique<DropOldestPolicy>()};
  buffer.admits = [](std::size_t waiting) { return waiting < 1; };
  const Delivery delivery = simulate(frames(5), LinkModel{4000, 0, 0}, std::move(buffer));
  EXPECT_THAT(delivery.received, ElementsAre(0, 1, 3));  // 250 ms a frame
  EXPECT_THAT(delivery.drops_after, ElementsAre(0, 0, 1, 1, 2));
}

TEST(Simulation, WhatWaitsAtTheEndIsStillDelivered) {
  const Delivery delivery = drop_oldest(3, {1000, 0, 0});  // a second a frame
  EXPECT_THAT(delivery.received, ElementsAre(0, 1, 2));
}

}  // namespace
}  // namespace orbbuf::sim
