// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "common/error.hpp"

namespace orbbuf {

/// What the page shows of a fleet of servers; empty functions: this server is alone.
struct FleetPage {
  /// Servers and sessions as JSON: the answer comes later, or from within the call.
  std::function<void(std::function<void(const Result<std::string>&)>)> overview;
  std::function<std::string()> metrics;  ///< in Prometheus' form
};

}  // namespace orbbuf
