// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "daemon/capture/camera_stream.hpp"
#include "daemon/capture/source_settings.hpp"

namespace orbbuf {

/// Opens the camera of `[source]` by libcamera: one whose image is made by a processor beside the
/// sensor, as on a Raspberry Pi, or a USB camera. Its pipeline may adjust size and format, which is
/// logged. Throws as OpenCamera does.
std::unique_ptr<CameraStream> open_libcamera_stream(const SourceSettings& settings);

}  // namespace orbbuf
