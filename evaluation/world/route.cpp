// SPDX-License-Identifier: Apache-2.0
#include "evaluation/world/route.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <utility>

#include "evaluation/random.hpp"

namespace orbbuf::evaluation {
namespace {

constexpr double kQuarter = std::numbers::pi / 2;
constexpr double kRamp = 0.15;  // of a drive's time: until full speed, and to standstill

/// From 0 to 1, starting and ending slowly.
double turn_ease(double p) { return 0.5 - 0.5 * std::cos(std::numbers::pi * p); }

/// From 0 to 1, at constant speed but for a ramp at each end.
double drive_ease(double p) {
  const double speed = 1 / (1 - kRamp);
  if (p < kRamp) return speed * p * p / (2 * kRamp);
  if (p > 1 - kRamp) return 1 - speed * (1 - p) * (1 - p) / (2 * kRamp);
  return speed * (p - kRamp / 2);
}

CameraPose along(const CameraPose& from, double length_m, double turn) {
  CameraPose pose = from;
  if (turn == 0) {
    pose.x += length_m * std::cos(from.heading);
    pose.y += length_m * std::sin(from.heading);
    return pose;
  }
  const double radius = length_m / turn;
  pose.heading += turn;
  pose.x += radius * (std::sin(pose.heading) - std::sin(from.heading));
  pose.y -= radius * (std::cos(pose.heading) - std::cos(from.heading));
  return pose;
}

/// East, then north or south, then east again: such legs never cross.
int next_direction(int direction, std::mt19937_64& random) {
  if (direction != 0) return 0;
  return uniform(random, 0, 1) < 0.5 ? 1 : -1;
}

}  // namespace

Route::Route(const Style& style, std::uint64_t seed, double duration_s) : style_(style) {
  std::mt19937_64 random(seed);
  Cell at{0, 0};
  int direction = 0;
  bool is_arc = false;  // the corner before this leg
  Phase drive;
  double driven_s = 0;  // at least, turns on the spot not counted
  while (driven_s <= duration_s) {
    const int cells =
        style.leg_min + static_cast<int>(uniform(random, 0, style.leg_max - style.leg_min + 1));
    const Cell step{direction == 0 ? 1 : 0, direction};
    for (int i = 0; i < cells; ++i) {
      cells_.push_back(at);
      at = {at.x + step.x, at.y + step.y};
    }
    corners_.push_back(at);
    const int next = next_direction(direction, random);
    const double turn = (next - direction) * kQuarter;
    const bool next_is_arc = uniform(random, 0, 1) < style.arc_share;
    drive.pieces.push_back({(cells - is_arc - next_is_arc) * style.cell_m, 0, 1});
    driven_s += cells * style.cell_m / style.speed_m_s;
    if (next_is_arc) {
      drive.pieces.push_back({kQuarter * style.cell_m, turn, style.arc_slower});
    } else {
      add_phase(std::exchange(drive, {}));
      Phase spot;
      spot.turn = turn;
      spot.duration_s = uniform(random, style.turn_s_min, style.turn_s_max);
      add_phase(spot);
    }
    is_arc = next_is_arc;
    direction = next;
  }
  if (!drive.pieces.empty()) add_phase(std::move(drive));
  for (int i = 0; i < 8; ++i) {  // the way goes on where the drive has ended
    cells_.push_back(at);
    at = {at.x + (direction == 0 ? 1 : 0), at.y + direction};
  }
}

void Route::add_phase(Phase phase) {
  for (const Piece& piece : phase.pieces) phase.paced_m += piece.paced_m();
  if (!phase.pieces.empty()) {
    phase.duration_s = phase.paced_m / style_.speed_m_s / (1 - kRamp);
  }
  if (!phases_.empty()) {
    const Phase& last = phases_.back();
    phase.begin_s = last.begin_s + last.duration_s;
    phase.start = last.start;
    for (const Piece& piece : last.pieces) {
      phase.start = along(phase.start, piece.length_m, piece.turn);
    }
    phase.start.heading += last.turn;
  }
  phases_.push_back(std::move(phase));
}

CameraPose Route::axis_at(double t_s) const {
  const auto after = std::ranges::upper_bound(phases_, t_s, {}, &Phase::begin_s);
  const Phase& phase = after == phases_.begin() ? phases_.front() : *std::prev(after);
  const double p = std::clamp((t_s - phase.begin_s) / phase.duration_s, 0.0, 1.0);
  CameraPose pose = phase.start;
  pose.heading += phase.turn * turn_ease(p);
  double left_m = phase.paced_m * drive_ease(p);
  for (const Piece& piece : phase.pieces) {
    const double share = std::min(1.0, left_m / piece.paced_m());
    pose = along(pose, piece.length_m * share, piece.turn * share);
    left_m -= piece.paced_m();
    if (left_m <= 0) break;
  }
  return pose;
}

CameraPose Route::at(double t_s) const {
  CameraPose pose = axis_at(t_s);
  const double sway_m = 0.015 * style_.cell_m;
  pose.heading += 0.012 * std::sin(4.1 * t_s) + 0.006 * std::sin(9.7 * t_s + 1);
  const double c = std::cos(pose.heading);
  const double s = std::sin(pose.heading);
  pose.x += style_.ahead_m * c + style_.aside_m * s + sway_m * std::sin(2.9 * t_s);
  pose.y += style_.ahead_m * s - style_.aside_m * c + sway_m * std::sin(3.7 * t_s + 2);
  pose.z = style_.camera_m + 0.5 * sway_m * std::sin(6.3 * t_s);
  return pose;
}

}  // namespace orbbuf::evaluation
