// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "daemon/capture/camera_stream.hpp"
#include "daemon/capture/source_settings.hpp"

namespace orbbuf {

/// A camera that libcamera drives: one whose image is made by a processor beside the sensor, as on
/// a Raspberry Pi, or a USB camera.
class LibcameraStream : public CameraStream {
 public:
  /// Opens the camera of `[source]`. Its pipeline may adjust size and format, which is logged.
  /// Throws as OpenCamera does.
  explicit LibcameraStream(const SourceSettings& settings);
  ~LibcameraStream() override;

  int fd() const override;
  const CameraMode& mode() const override;
  std::string description() const override;
  Result<std::optional<CameraBuffer>> borrow() override;
  std::optional<Error> give_back(const CameraBuffer& buffer) override;

 private:
  class Capture;
  std::unique_ptr<Capture> capture_;
};

}  // namespace orbbuf
