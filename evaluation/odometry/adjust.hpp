// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "evaluation/camera.hpp"
#include "evaluation/odometry/map.hpp"

namespace orbbuf::evaluation {

/// Bundle adjustment of the newest `window` keyframes, of which the oldest `fixed` stay, and of the
/// points they see: Levenberg-Marquardt on the reprojection errors (Huber, 1.5 px), points
/// eliminated by Schur's complement. Two fixed ones hold the scale of a single camera.
void adjust(const Camera& camera, Keyframes& keyframes, std::vector<Track>& tracks,
            std::size_t window, std::size_t fixed);

}  // namespace orbbuf::evaluation
