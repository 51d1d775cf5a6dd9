// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "daemon/settings.hpp"

namespace orbbuf {

/// Runs one session, from opening the source to the last acknowledgement: builds all parts, runs
/// `main`'s io_context, and returns at the end of the source or on SIGINT or SIGTERM (a second
/// signal ends it at once). False if the source failed, or if frames could not be delivered.
/// Throws std::runtime_error if it cannot start.
bool run_robot(const Settings& settings);

}  // namespace orbbuf
