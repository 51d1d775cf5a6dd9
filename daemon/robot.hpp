// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "daemon/settings.hpp"

namespace orbbuf {

/// Runs one session, from opening the source to the last acknowledgement: builds all parts, runs
/// `main`'s io_context, and returns at the end of the source or on SIGINT or SIGTERM (a second
/// signal ends it at once). Returns the exit status of the program: 1 if the source failed, or if
/// the source ended and the server has not answered the end of the session; kFramesLost if at the
/// end frames were neither delivered nor kept. Throws std::runtime_error if it cannot start.
int run_robot(const Settings& settings);

inline constexpr int kFramesLost = 3;

}  // namespace orbbuf
