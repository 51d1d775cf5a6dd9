// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "server/recording/segment_info.hpp"

namespace orbbuf {

/// Whose frames they are. Both ids are safe as file names (wire::is_valid_id).
struct SessionInfo {
  std::string robot_id;
  std::string session_id;
  std::string calibration;  ///< camera.txt in DSO's form; may be empty
  SegmentInfo segment{};    ///< not the first: other servers have the session's beginning

  /// The session's, below the robot's.
  std::string folder() const {
    return segment.is_first() ? session_id : session_id + ".e" + std::to_string(segment.epoch);
  }
};

}  // namespace orbbuf
