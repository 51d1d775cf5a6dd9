// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/scene_pose.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace orbbuf {
namespace {

constexpr double kCycleS = 12.0;
constexpr double kTurnS = 3.0;       // the last of each cycle
constexpr double kSlowSpeed = 0.06;  // view widths a second
constexpr double kTurnSpeed = 1.8;   // the same, added at the middle of the turn
constexpr double kRollDepth = 0.25;  // radians either way

/// How far the camera has come, in view widths. Everything it does is a smooth function of this, so
/// that this alone makes the slow stretches slow and the turns fast.
double path_at(double time_s) {
  const double cycles = std::floor(time_s / kCycleS);
  const double in_cycle_s = time_s - cycles * kCycleS;
  const double in_turn_s = std::max(0.0, in_cycle_s - (kCycleS - kTurnS));
  // The speed of a turn is kTurnSpeed * sin^2(pi s / kTurnS); this is its integral.
  const double turned =
      kTurnSpeed * (in_turn_s / 2 - kTurnS / (4 * std::numbers::pi) *
                                        std::sin(2 * std::numbers::pi * in_turn_s / kTurnS));
  return kSlowSpeed * time_s + cycles * kTurnSpeed * kTurnS / 2 + turned;
}

}  // namespace

ScenePose scene_pose_at(double time_s) {
  const double path = path_at(time_s);
  return {path, 0.3 * path + 0.2 * std::sin(0.9 * path), 1 + kSceneZoomDepth * std::sin(0.7 * path),
          kRollDepth * std::sin(1.1 * path)};
}

}  // namespace orbbuf
