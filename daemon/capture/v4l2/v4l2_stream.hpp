// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "daemon/capture/buffer_mapping.hpp"
#include "daemon/capture/camera_stream.hpp"
#include "daemon/capture/source_settings.hpp"
#include "daemon/capture/v4l2/v4l2_device.hpp"

namespace orbbuf {

/// A camera of the kernel's (V4L2): USB, CSI with a plain driver, or simulated. Its buffers are
/// mapped here.
class V4l2Stream : public CameraStream {
 public:
  /// The camera of `[source]`. Throws as OpenCamera does.
  explicit V4l2Stream(const SourceSettings& settings);
  ~V4l2Stream() override;

  int fd() const override { return device_.fd(); }
  const CameraMode& mode() const override { return mode_; }
  std::string description() const override;
  Result<std::optional<CameraBuffer>> borrow() override;
  std::optional<Error> give_back(const CameraBuffer& buffer) override;

 private:
  void set_crop(const Crop& crop);
  void undo_crop();
  void set_format(const SourceSettings& settings);
  void set_rate(double fps);
  void map_buffers();

  V4l2Device device_;
  CameraMode mode_;
  std::vector<BufferMapping> buffers_;
};

}  // namespace orbbuf
