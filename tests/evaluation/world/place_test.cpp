// SPDX-License-Identifier: Apache-2.0
#include "evaluation/world/place.hpp"

#include <gtest/gtest.h>

namespace orbbuf::evaluation {
namespace {

constexpr double kDuration_s = 30;

TEST(Place, TellsHowFarTheWallIs) {
  const Route route(kCorridor, 1, kDuration_s);
  const Place place(kCorridor, route, 1);
  const WallHit hit = place.look(0, 0, -2, 0);  // distances are in units of 2 m
  int free_cells = 1;
  while (place.is_free({-free_cells, 0})) ++free_cells;
  EXPECT_GE(free_cells, 2);
  EXPECT_NEAR(hit.distance_m, (free_cells - 0.5) / 2, 1e-9);
  EXPECT_TRUE(hit.faces_x);
}

}  // namespace
}  // namespace orbbuf::evaluation
