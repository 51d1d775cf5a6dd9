// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/frame.hpp"

namespace orbbuf {

/// What a robot has said it keeps of a session, to send it later: the file `spool.csv` of the
/// session's folder.
struct RobotHolds {
  std::uint64_t held = 0;        ///< frames
  Sequence first = 0;            ///< their lowest number; without a meaning if there are none
  std::int64_t reported_ns = 0;  ///< when it said so, since the Unix epoch

  friend bool operator==(const RobotHolds&, const RobotHolds&) = default;
};

/// A header and a line: `12,345,1763779406.123456789`, or `0,,1763779406.123456789`.
std::string to_csv(const RobotHolds& holds);
/// to_csv() read back; nothing if it is not that.
std::optional<RobotHolds> holds_from_csv(std::string_view text);

}  // namespace orbbuf
