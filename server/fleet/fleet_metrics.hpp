// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "server/fleet/fleet.hpp"

namespace orbbuf::fleet {

/// For /metrics, in Prometheus' text format; docs/fleet.md lists the names.
std::string to_prometheus(const Fleet& fleet);

}  // namespace orbbuf::fleet
