// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/list_cameras.hpp"

#include <fmt/format.h>

#include <stdexcept>

#ifdef ORBBUF_LIBCAMERA
#include "daemon/capture/libcamera/libcamera_manager.hpp"
#endif
#ifdef ORBBUF_V4L2
#include "daemon/capture/v4l2/v4l2_controls.hpp"
#include "daemon/capture/v4l2/v4l2_device.hpp"
#endif

namespace orbbuf {

namespace {

#ifdef ORBBUF_V4L2

std::string describe(const CameraControl& control) {
  if (!control.menu.empty()) {
    return fmt::format("{}: {}; default {}", control.name, fmt::join(control.menu, ", "),
                       control.fallback);
  }
  return fmt::format("{}: {} to {}, default {}", control.name, control.min, control.max,
                     control.fallback);
}

std::string describe(const V4l2Device& device) {
  std::string text = fmt::format("{}: {}, {}\n", device.path(), device.name(), device.bus());
  text += list_offers(device.offers());
  for (const CameraControl& control : list_controls(device)) {
    text += fmt::format("  control {}\n", describe(control));
  }
  return text;
}

std::string list_v4l2() {
  std::string text;
  for (const std::string& node : video_nodes()) {
    try {
      text += describe(V4l2Device(node));
    } catch (const NoCamera&) {
      continue;
    } catch (const std::runtime_error& error) {
      text += fmt::format("{}: {}\n", node, error.what());
    }
  }
  return text.empty() ? "no V4L2 camera\n" : text;
}

#else

std::string list_v4l2() { return "no V4L2 camera: orbbufd was built without V4L2\n"; }

#endif

#ifdef ORBBUF_LIBCAMERA

std::string libcamera_list() {
  try {
    const std::string text = list_libcamera();
    return text.empty() ? "no libcamera camera\n" : text;
  } catch (const std::runtime_error& error) {
    return fmt::format("no libcamera camera: {}\n", error.what());
  }
}

#else

std::string libcamera_list() {
  return "no libcamera camera: orbbufd was built without libcamera\n";
}

#endif

}  // namespace

std::string list_cameras() { return list_v4l2() + libcamera_list(); }

}  // namespace orbbuf
