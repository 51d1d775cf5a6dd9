// SPDX-License-Identifier: Apache-2.0
#include "evaluation/world/place.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <random>

#include "evaluation/random.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr int kMargin = 4;  // cells of wall around all
constexpr int kFarthest = 100;
constexpr int kSection = 4;  // cells
constexpr int kBareZone = 8;
constexpr double kNiches = 0.35;  // a cell of the way has one
constexpr double kPillars = 0.10;
constexpr double kBlankWalls = 0.25;
constexpr double kBareZones = 0.25;

std::uint64_t mix(std::uint64_t seed, std::int64_t a, std::int64_t b, std::int64_t c) {
  return hash(hash(hash(seed + static_cast<std::uint64_t>(a)) + static_cast<std::uint64_t>(b)) +
              static_cast<std::uint64_t>(c));
}

int zone(int cell, int size) { return (cell >= 0 ? cell : cell - size + 1) / size; }

bool is_near(const std::vector<Cell>& corners, Cell cell) {
  return std::ranges::any_of(corners, [cell](Cell corner) {
    return std::abs(corner.x - cell.x) <= 3 && std::abs(corner.y - cell.y) <= 3;
  });
}

}  // namespace

Place::Place(const Style& style, const Route& route, std::uint64_t seed)
    : cell_m_(style.cell_m), seed_(seed) {
  const auto& way = route.cells();
  const auto [low_x, high_x] = std::ranges::minmax(way, {}, &Cell::x);
  const auto [low_y, high_y] = std::ranges::minmax(way, {}, &Cell::y);
  origin_ = {low_x.x - kMargin, low_y.y - kMargin};
  width_ = high_x.x - low_x.x + 2 * kMargin + 1;
  height_ = high_y.y - low_y.y + 2 * kMargin + 1;
  free_.assign(static_cast<std::size_t>(width_) * static_cast<std::size_t>(height_), 0);
  std::mt19937_64 random(seed);
  for (const Cell cell : way) {
    for (int dx = -1; dx <= 1; ++dx) {
      for (int dy = -1; dy <= 1; ++dy) set({cell.x + dx, cell.y + dy}, 1);
    }
    if (uniform(random, 0, 1) >= kNiches) continue;
    const int depth = uniform(random, 0, 1) < 0.6 ? 2 : 3;
    const int side = uniform(random, 0, 1) < 0.5 ? -1 : 1;
    for (int d = 1; d <= depth; ++d) {
      set({cell.x + side * d, cell.y}, 1);
      set({cell.x, cell.y + side * d}, 1);
    }
  }
  for (std::size_t i = 1; i + 1 < way.size(); ++i) {
    if (uniform(random, 0, 1) >= kPillars || is_near(route.corners(), way[i])) continue;
    const int side = uniform(random, 0, 1) < 0.5 ? -1 : 1;
    const bool is_along_x = way[i].y == way[i - 1].y;
    const Cell pillar{way[i].x + (is_along_x ? 0 : side), way[i].y + (is_along_x ? side : 0)};
    set(pillar, 0);
  }
}

std::size_t Place::index_of(Cell cell) const {
  return static_cast<std::size_t>(cell.y - origin_.y) * static_cast<std::size_t>(width_) +
         static_cast<std::size_t>(cell.x - origin_.x);
}

bool Place::is_inside(Cell cell, int margin) const {
  const int x = cell.x - origin_.x;
  const int y = cell.y - origin_.y;
  return x >= margin && y >= margin && x + margin < width_ && y + margin < height_;
}

void Place::set(Cell cell, std::uint8_t is_free) {
  if (is_inside(cell, 1)) free_[index_of(cell)] = is_free;
}

bool Place::is_free(Cell cell) const { return is_inside(cell, 0) && free_[index_of(cell)] != 0; }

double Place::bareness(int cell_x, int cell_y) const {
  const auto mixed = mix(seed_ + 7, zone(cell_x, kBareZone), zone(cell_y, kBareZone), 1);
  return hash_unit(mixed) < kBareZones ? 0.22 : 1;
}

double Place::floor_contrast(double x, double y) const {
  // A cell's middle is at whole numbers.
  return 0.45 * bareness(static_cast<int>(std::floor(x / cell_m_ + 0.5)),
                         static_cast<int>(std::floor(y / cell_m_ + 0.5)));
}

WallHit Place::look(double x, double y, double direction_x, double direction_y) const {
  const double start_x = x / cell_m_ + 0.5;
  const double start_y = y / cell_m_ + 0.5;
  Cell cell{static_cast<int>(std::floor(start_x)), static_cast<int>(std::floor(start_y))};
  constexpr double kNever = std::numeric_limits<double>::infinity();
  const Cell step{direction_x > 0 ? 1 : -1, direction_y > 0 ? 1 : -1};
  const double each_x = direction_x == 0 ? kNever : std::abs(1 / direction_x);
  const double each_y = direction_y == 0 ? kNever : std::abs(1 / direction_y);
  double next_x =
      direction_x == 0 ? kNever : (cell.x + (step.x > 0 ? 1 : 0) - start_x) / direction_x;
  double next_y =
      direction_y == 0 ? kNever : (cell.y + (step.y > 0 ? 1 : 0) - start_y) / direction_y;
  WallHit hit;
  double distance = 0;
  for (int i = 0; i < kFarthest && is_free(cell); ++i) {
    hit.faces_x = next_x < next_y;
    if (hit.faces_x) {
      distance = next_x;
      next_x += each_x;
      cell.x += step.x;
    } else {
      distance = next_y;
      next_y += each_y;
      cell.y += step.y;
    }
  }
  hit.distance_m = distance * cell_m_;
  hit.along_m = hit.faces_x ? y + hit.distance_m * direction_y : x + hit.distance_m * direction_x;
  const int across = hit.faces_x ? cell.x : cell.y;
  const int side = hit.faces_x ? step.x : step.y;
  const int along = zone(hit.faces_x ? cell.y : cell.x, kSection);
  hit.section = mix(seed_, 4 * across + 2 * (side > 0) + hit.faces_x, along, 0);
  const double blank = hash_unit(hit.section + 1);
  hit.contrast = blank < kBlankWalls ? 0.10 : 0.5 + 0.5 * hash_unit(hit.section + 2);
  hit.contrast *= bareness(cell.x, cell.y);
  return hit;
}

}  // namespace orbbuf::evaluation
