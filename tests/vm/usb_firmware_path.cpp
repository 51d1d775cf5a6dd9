// SPDX-License-Identifier: Apache-2.0
// To be preloaded: libcamera refuses a USB camera whose bus the machine's firmware does not know,
// as is a virtual one.
#include <string>

namespace libcamera::sysfs {

std::string firmwareNodePath(const std::string& device);

std::string firmwareNodePath(const std::string& device) {
  return device.find("vhci_hcd") == std::string::npos ? "" : "virtual";
}

}  // namespace libcamera::sysfs
