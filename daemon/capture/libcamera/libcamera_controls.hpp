// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/capture/crop.hpp"

namespace libcamera {
class ControlInfoMap;
class ControlList;
}  // namespace libcamera

namespace orbbuf {

/// The name to set a libcamera control by: ExposureTime is exposure_time.
std::string libcamera_control_name(std::string_view name);

/// `values` by their names, as a list to start the camera with. Throws std::runtime_error naming
/// the control and its range, or all names if there is no such control. Only controls with one
/// number can be set: true and false are 1 and 0.
libcamera::ControlList control_list(const libcamera::ControlInfoMap& offered,
                                    const std::map<std::string, double>& values);

/// Adds the rate to `list`, as near to `fps` as the camera allows. Returns it; 0 if the camera
/// takes no rate.
double set_rate(libcamera::ControlList& list, const libcamera::ControlInfoMap& offered, double fps);

/// Adds the crop of the sensor to `list`. Throws std::runtime_error if the camera does not support
/// cropping. The camera may adjust the crop without reporting it.
void set_crop(libcamera::ControlList& list, const libcamera::ControlInfoMap& offered,
              const Crop& crop);

/// Every control that control_list() can set: `exposure_time: 0 to 66666, default 20000`.
std::vector<std::string> describe_controls(const libcamera::ControlInfoMap& offered);

}  // namespace orbbuf
