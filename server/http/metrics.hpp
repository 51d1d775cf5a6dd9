// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "server/live/figures.hpp"

namespace orbbuf {

inline constexpr std::string_view kMetricsType = "text/plain; version=0.0.4; charset=utf-8";

/// The figures in Prometheus' text format; docs/live-page.md lists the names.
std::string to_metrics(const Figures& figures, RobotFigures::Time now);

}  // namespace orbbuf
