// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "common/command_line.hpp"

namespace orbbuf {

/// `join` and `drain`; each sets `command`, which returns the exit status.
void add_fleet_commands(CommandLine& app, std::function<int()>& command);

}  // namespace orbbuf
