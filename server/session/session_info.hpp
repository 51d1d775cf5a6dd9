// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "common/wire.hpp"

namespace orbbuf {

/// Whose frames they are. Both ids are safe as file names (wire::is_valid_id).
struct SessionInfo {
  std::string robot_id;
  std::string session_id;
  std::string calibration;                         ///< camera.txt in DSO's form; may be empty
  std::vector<wire::StreamDeclaration> streams{};  ///< the server takes, from kFirstOther on

  friend bool operator==(const SessionInfo&, const SessionInfo&) = default;
};

/// Whether an item of that number can follow the position. One far beyond it would make the server
/// take the robot's next ones for repeats.
constexpr bool can_follow(std::uint64_t number, std::uint64_t position) {
  constexpr std::uint64_t kMost = std::uint64_t{1} << 32;  // 49 days of 1000 a second
  return number < position || number - position < kMost;
}

/// How a session was left.
struct SessionClosing {
  bool has_ended = false;  ///< the robot said bye: no frame of the live stream follows
  /// What the robot last reported; with a bye `captured` is the number in that.
  std::optional<wire::Stats> stats{};
  /// What the robot last reported; to be added to all capture times of the session, which keep the
  /// clock that the robot had at its beginning.
  std::optional<std::int64_t> clock_offset_ns{};

  friend bool operator==(const SessionClosing&, const SessionClosing&) = default;
};

}  // namespace orbbuf
