// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "server/settings.hpp"

namespace orbbuf {

/// The server's life: listens, serves, and returns when SIGINT or SIGTERM has come and all is
/// closed in good order. A second signal does not wait for that: it ends the process at once, with
/// status 1.
///
/// Runs the io_context on the calling thread, which it names `main`, and blocking work on a thread
/// named `files`. Ignores SIGPIPE from here on. Throws std::runtime_error if it cannot begin.
void serve(const Settings& settings);

}  // namespace orbbuf
