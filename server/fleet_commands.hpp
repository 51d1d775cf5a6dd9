// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace orbbuf {

/// `join` and `drain`; each sets `command`, which returns the exit status.
void add_fleet_commands(CLI::App& app, std::function<int()>& command);

}  // namespace orbbuf
