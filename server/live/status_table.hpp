// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "server/live/figures.hpp"

namespace orbbuf {

/// The figures for a terminal: a heading, and a line for each robot.
std::string to_table(const Figures& figures, RobotFigures::Time now);

}  // namespace orbbuf
