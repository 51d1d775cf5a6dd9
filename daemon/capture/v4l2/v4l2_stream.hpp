// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "daemon/capture/camera_stream.hpp"
#include "daemon/capture/source_settings.hpp"

namespace orbbuf {

/// Opens the camera of `[source]`, one of the kernel's (V4L2): USB, CSI with a plain driver, or
/// simulated. Throws as OpenCamera does.
std::unique_ptr<CameraStream> open_v4l2_stream(const SourceSettings& settings);

}  // namespace orbbuf
