// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <vector>

#include "bench/session_outcome.hpp"

namespace orbbuf::bench {

/// A span of capture time in which the link was down.
struct Outage {
  double begin_s = 0;
  double end_s = 0;
};

/// Draws one timeline a session, above one another on the same axis of capture time: a tick for
/// each captured frame (delivered or dropped), and below it the similarity between delivered
/// neighbours. Writes a PNG. Throws std::runtime_error if it cannot.
void draw_timelines(const std::vector<SessionOutcome>& sessions, const Outage& outage,
                    const std::filesystem::path& png);

}  // namespace orbbuf::bench
