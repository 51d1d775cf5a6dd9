// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

#include "common/text_lines.hpp"

namespace orbbuf {

/// A line of a calibration begins with `cam0:`, as in Kalibr's camchain.yaml. Otherwise it is DSO's
/// camera.txt.
inline bool is_kalibr(std::string_view calibration) {
  while (!calibration.empty()) {
    if (take_line(calibration).starts_with("cam0:")) return true;
  }
  return false;
}

}  // namespace orbbuf
