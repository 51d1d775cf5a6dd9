// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "server/live/figures.hpp"

namespace orbbuf {

/// What the page shows of all robots, as JSON (docs/live-page.md). Of the timelines the seconds
/// that have changed since `since_ms`, which is what an earlier answer gave as its `clock_ms`.
std::string to_json(const Figures& figures, std::uint64_t since_ms, RobotFigures::Time now);

}  // namespace orbbuf
