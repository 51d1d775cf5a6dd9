// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "daemon/capture/camera_formats.hpp"
#include "daemon/capture/camera_unpack.hpp"
#include "daemon/capture/source_settings.hpp"

namespace libcamera {
class Camera;
class PixelFormat;
class Stream;
class StreamFormats;
}  // namespace libcamera

namespace orbbuf {

/// libcamera's name for `format`, which is Linux DRM's, and back; nothing for a format that is not
/// read. Beware: its RGB888 is blue, green, red in memory, our BGR24.
libcamera::PixelFormat pixel_format_of(CameraFormat format);
std::optional<CameraFormat> format_of(const libcamera::PixelFormat& pixels);

/// What is offered, by V4L2's four characters or, of what is not read, libcamera's name. Rates are
/// not known.
std::vector<CameraOffer> offers_of(const libcamera::StreamFormats& formats);
std::vector<CameraOffer> offers_of(libcamera::Camera& camera);

/// The model name that the camera reports.
std::string model_of(const libcamera::Camera& camera);

/// The format to ask for: choose_format()'s, if need be at a size that is not offered, or the one
/// that is named; the camera's pipeline adjusts what it cannot do. Fails where nothing would serve.
Result<CameraFormat> choose_to_ask(const std::vector<CameraOffer>& offers,
                                   const CameraRequest& request);

struct LibcameraSetup {
  libcamera::Stream* stream = nullptr;  ///< the camera's own
  CameraMode mode;                      ///< as adjusted; its rate is not known yet
};

/// Configures an acquired camera as `[source]` says. Its pipeline may adjust size and format, which
/// is logged. Throws std::runtime_error, with a list of the offers, if the result is not usable.
LibcameraSetup set_up(libcamera::Camera& camera, const SourceSettings& settings);

}  // namespace orbbuf
