// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/wire.hpp"

namespace orbbuf {

/// How a session was left: the file `end.csv` of its folder. A session that another server has
/// recorded before there was this file has none.
struct SessionClosing {
  bool has_ended = false;  ///< the robot said bye: no frame follows
  /// What the robot last reported; with a bye `captured` is the number in that.
  std::optional<wire::Stats> stats;

  friend bool operator==(const SessionClosing&, const SessionClosing&) = default;
};

/// A header and a line: `ended,500,0,0,3,497`, or `open,,,,,` as long as no stats are known.
std::string to_csv(const SessionClosing& closing);
std::optional<SessionClosing> closing_from_csv(std::string_view text);

}  // namespace orbbuf
