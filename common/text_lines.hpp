// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <string_view>

namespace orbbuf {

/// Takes the first line off `text`, which is not empty; without its line end.
inline std::string_view take_line(std::string_view& text) {
  const auto end = std::min(text.find('\n'), text.size());
  const std::string_view line = text.substr(0, end);
  text.remove_prefix(std::min(end + 1, text.size()));
  return line;
}

/// A line of a calibration begins with `cam0:`, as in Kalibr's camchain.yaml. Otherwise it is DSO's
/// camera.txt.
inline bool is_kalibr(std::string_view calibration) {
  while (!calibration.empty()) {
    if (take_line(calibration).starts_with("cam0:")) return true;
  }
  return false;
}

}  // namespace orbbuf
