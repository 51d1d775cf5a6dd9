// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "common/error.hpp"

namespace orbbuf {

/// What the page shows of a fleet of servers; empty functions: this server is alone.
struct FleetPage {
  /// Servers and a page of sessions, from `from` on, as JSON: the answer comes later, or from
  /// within the call.
  std::function<void(const std::string& from, std::function<void(const Result<std::string>&)>)>
      overview;
  std::function<std::string()> metrics;  ///< in Prometheus' form
};

}  // namespace orbbuf
