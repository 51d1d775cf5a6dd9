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
  std::optional<wire::Stats> stats{};
  /// What the robot last reported; to be added to the capture times of all files of the session,
  /// which keep the clock that the robot had at its beginning.
  std::optional<std::int64_t> clock_offset_ns{};

  friend bool operator==(const SessionClosing&, const SessionClosing&) = default;
};

/// A header and a line: `ended,500,0,0,3,497,0`, or `open,,,,,,` as long as nothing is known.
std::string to_csv(const SessionClosing& closing);
/// Without its last column, too, which older servers did not write.
std::optional<SessionClosing> closing_from_csv(std::string_view text);

}  // namespace orbbuf
