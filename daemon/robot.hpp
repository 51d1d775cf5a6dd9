// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "daemon/settings.hpp"

namespace orbbuf {

/// One session, from opening the source to the last acknowledgement: builds everything, runs
/// `main`'s io_context, and ends at the end of the source or on SIGINT or SIGTERM (a second signal
/// ends it at once). False if the source failed, or ended with frames that could not be delivered.
/// Throws std::runtime_error if something needed to start is not there.
bool run_robot(const Settings& settings);

}  // namespace orbbuf
