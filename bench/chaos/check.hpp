// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace orbbuf::chaos {

/// One run of a robot's daemon: what it left behind, and what the server did.
struct Session {
  std::string name;             ///< for messages
  std::filesystem::path files;  ///< the server's folder of it; may be missing
  std::filesystem::path log;    ///< all that the robot printed
  /// By -9; otherwise it ended in peace, everything said. A robot with a record of its own has been
  /// started again since.
  bool was_killed = false;
  bool lost_power = false;  ///< with that: of its own files only what was synced is there
  bool has_spool = false;   ///< then every frame that was dropped must have come late
};

/// Frames of all sessions, each counted once.
struct CheckResult {
  std::uint64_t captured = 0;
  std::uint64_t delivered = 0;
  std::uint64_t late = 0;             ///< of those delivered
  std::uint64_t reduced = 0;          ///< of those, sent with a smaller JPEG than was captured
  std::uint64_t dropped = 0;          ///< in the server's drop record
  std::uint64_t died_with_robot = 0;  ///< captured by a robot that was killed before it could tell
  std::uint64_t lost = 0;             ///< should be in one of these and is not
  std::uint64_t repeated = 0;         ///< is in them more than once
  std::uint64_t unexplained = 0;      ///< anything else that does not fit, as `problems` say
  std::vector<std::string> problems;  ///< a line for each lost, repeated or unexplained thing
};

/// Whether each frame of each session is exactly once on disk or in the drop record, from the files
/// alone: it shares no code with what it checks. `source`: the JPEGs, sorted by name, that all
/// robots replay again and again, so that frame n of a session is the n-th of them, cyclically; if
/// there are none, the images' bytes are not checked. A reduced image is checked by what
/// quality.csv says of the JPEG that it was made from.
CheckResult check(const std::vector<Session>& sessions, const std::filesystem::path& source);

}  // namespace orbbuf::chaos
