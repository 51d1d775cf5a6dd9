// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "evaluation/odometry/trajectory.hpp"

namespace orbbuf::evaluation {

/// Where the camera was at these times, in the order of the frames: TUM's form, between whose poses
/// it is interpolated, or KITTI's, whose lines (12 numbers) are the frames'. Nothing where the file
/// has none. Throws std::runtime_error.
std::vector<std::optional<Eigen::Isometry3d>> truth_of_frames(const std::filesystem::path& file,
                                                              const std::vector<double>& times_s);

}  // namespace orbbuf::evaluation
