// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "evaluation/world/route.hpp"

namespace orbbuf::evaluation {

/// Where a ray along the floor meets a wall.
struct WallHit {
  double distance_m = 0;      ///< in units of the ray's direction
  double along_m = 0;         ///< place along the wall, in world coordinates
  std::uint64_t section = 0;  ///< number of the four cells of wall that look alike
  double contrast = 1;        ///< of its texture; near 0: blank
  bool faces_x = false;       ///< which way it faces, and so how bright it is
};

/// The cells that are free and those that are wall: ways three cells wide along a route, with
/// niches and pillars beside them. Some stretches are bare: floor and walls nearly blank.
class Place {
 public:
  Place(const Style& style, const Route& route, std::uint64_t seed);

  /// The first wall from (x, y) in this direction (of any length but 0), at most 100 cells away.
  WallHit look(double x, double y, double direction_x, double direction_y) const;

  /// Of the floor at this place.
  double floor_contrast(double x, double y) const;

  bool is_free(Cell cell) const;

 private:
  std::size_t index_of(Cell cell) const;
  bool is_inside(Cell cell, int margin) const;
  void set(Cell cell, std::uint8_t is_free);
  double bareness(int cell_x, int cell_y) const;

  double cell_m_;
  std::uint64_t seed_;
  Cell origin_;  ///< of the grid
  int width_ = 0;
  int height_ = 0;
  std::vector<std::uint8_t> free_;
};

}  // namespace orbbuf::evaluation
