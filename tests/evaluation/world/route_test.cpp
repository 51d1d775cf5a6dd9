// SPDX-License-Identifier: Apache-2.0
#include "evaluation/world/route.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "evaluation/world/place.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr double kDuration_s = 30;

TEST(Route, MovesAndTurnsWithoutJumps) {
  const Route route(kCorridor, 1, kDuration_s);
  double turned = 0;
  for (double t = 0; t < kDuration_s - 0.01; t += 0.01) {
    const CameraPose a = route.at(t);
    const CameraPose b = route.at(t + 0.01);
    EXPECT_LT(std::hypot(b.x - a.x, b.y - a.y), 0.03) << t;
    EXPECT_LT(std::abs(b.heading - a.heading), 0.03) << t;
    turned += std::abs(b.heading - a.heading);
  }
  EXPECT_GT(turned, std::numbers::pi);  // there are turns in it
}

TEST(Route, StaysInTheOpen) {
  for (const Style& style : {kCorridor, kStreet}) {
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const Route route(style, seed, kDuration_s);
      const Place place(style, route, seed);
      for (double t = 0; t < kDuration_s; t += 0.05) {
        const CameraPose pose = route.at(t);
        EXPECT_TRUE(place.is_free({static_cast<int>(std::lround(pose.x / style.cell_m)),
                                   static_cast<int>(std::lround(pose.y / style.cell_m))}))
            << "seed " << seed << " at " << t;
      }
    }
  }
}

TEST(Route, AnotherPassIsBesideTheFirst) {
  Style beside = kCorridor;
  beside.aside_m = 0.3;
  const Route route(kCorridor, 1, kDuration_s);
  const Route second(beside, 1, kDuration_s);
  for (double t = 0; t < kDuration_s; t += 0.5) {
    const CameraPose a = route.at(t);
    const CameraPose b = second.at(t);
    EXPECT_EQ(b.heading, a.heading);
    const double ahead = (b.x - a.x) * std::cos(a.heading) + (b.y - a.y) * std::sin(a.heading);
    const double left = (b.y - a.y) * std::cos(a.heading) - (b.x - a.x) * std::sin(a.heading);
    EXPECT_NEAR(ahead, 0, 1e-9) << t;
    EXPECT_NEAR(left, -0.3, 1e-9) << t;
  }
}

}  // namespace
}  // namespace orbbuf::evaluation
