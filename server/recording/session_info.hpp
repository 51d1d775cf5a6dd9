// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace orbbuf {

/// Whose frames they are. Both ids are safe as file names (wire::is_valid_id).
struct SessionInfo {
  std::string robot_id;
  std::string session_id;
  std::string calibration;  ///< camera.txt in DSO's form; may be empty
};

}  // namespace orbbuf
