// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace orbbuf {

class V4l2Device;

/// Settings of a camera by the names of its controls.
using CameraControls = std::map<std::string, double>;

/// A control as its driver has it.
struct CameraControl {
  std::uint32_t id = 0;
  std::string name;  ///< control_name() of the driver's
  std::int64_t min = 0;
  std::int64_t max = 0;
  std::int64_t step = 1;
  std::int64_t fallback = 0;
  std::vector<std::string> menu;  ///< `1 Manual Mode`; empty: any number of the range
  bool is_wide = false;           ///< 64 bits
  bool is_switch = false;         ///< a boolean, or a menu of words
};

/// The name to set a control by, which is the one v4l2-ctl has for it: "Exposure, Auto" becomes
/// exposure_auto, letters in lower case and all else between them one underscore.
std::string control_name(std::string_view driver_name);

/// Why `control` does not take `value`, with what it does take; empty: it may.
std::string why_refused(const CameraControl& control, double value);

/// Every control that has a number and can be set.
std::vector<CameraControl> list_controls(const V4l2Device& device);

/// The names of `values`, all of them of `controls`, in the order to set them in: switches first.
/// Switching an automatic mode off leaves its last number in the control, so the numbers must be
/// set after the switches.
std::vector<std::string> setting_order(const std::vector<CameraControl>& controls,
                                       const CameraControls& values);

/// Sets all of `values`, in setting_order(). A control may first need another one set (a manual
/// exposure needs exposure_auto off): what is refused is tried again as long as others are
/// accepted. Throws std::runtime_error naming the control and its range, or all names if there is
/// no such control.
void set_controls(const V4l2Device& device, const CameraControls& values);

}  // namespace orbbuf
