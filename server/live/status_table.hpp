// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "server/live/metrics.hpp"

namespace orbbuf {

/// The metrics for a terminal: a heading, and a line for each robot.
std::string to_table(const Metrics& metrics, RobotMetrics::Time now);

}  // namespace orbbuf
