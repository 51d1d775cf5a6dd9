// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "server/settings.hpp"

namespace orbbuf {

/// The server's life: listens, serves, and returns when SIGINT or SIGTERM has come and all is
/// closed in good order. A second signal does not wait for that: it ends the process at once, with
/// status 1.
///
/// Runs the io_context on the calling thread, which it names `main`, and blocking work on a thread
/// named `files`. Ignores SIGPIPE from here on. Throws std::runtime_error if it cannot begin.
///
/// On SIGHUP it reads the certificates again, and `listen.robots` by `read_robots`, which may throw
/// std::runtime_error: then all stays as it was.
void serve(const Settings& settings, const std::function<std::vector<std::string>()>& read_robots);

}  // namespace orbbuf
