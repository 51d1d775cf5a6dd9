// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "daemon/capture/buffer_mapping.hpp"
#include "daemon/capture/camera_stream.hpp"
#include "daemon/capture/source_settings.hpp"

namespace libcamera {
class FrameBuffer;
}  // namespace libcamera

namespace orbbuf {

/// The planes of a libcamera buffer in this process's memory, one mapping for each. The buffer must
/// outlive them. Planes may share a descriptor, and begin anywhere in it: the image processor of a
/// Raspberry Pi writes all planes of an image one behind the other.
class LibcameraPlanes {
 public:
  /// Without colour only the first plane is mapped: all that is read of an image is in it. If a
  /// mapping fails errno says why, and the object is false.
  LibcameraPlanes(const libcamera::FrameBuffer& buffer, bool color);

  explicit operator bool() const;

  /// The first `bytes_used` bytes of a plane, or less if the plane is smaller; empty if the plane
  /// does not exist or is not mapped.
  std::span<const std::uint8_t> filled(std::size_t plane, std::size_t bytes_used) const;

  /// Before and after the CPU reads: on some processors the cache does not contain what the camera
  /// has written. Memory that is no DMA buffer needs neither.
  void begin_reading() const;
  void end_reading() const;

 private:
  void synchronise(std::uint64_t moment) const;

  const libcamera::FrameBuffer& buffer_;
  std::vector<BufferMapping> mappings_;  // each from the start of its descriptor
};

/// Opens the camera of `[source]` by libcamera: one whose image is made by a processor beside the
/// sensor, as on a Raspberry Pi, or a USB camera. Its pipeline may adjust size and format, which is
/// logged. Throws as OpenCamera does.
std::unique_ptr<CameraStream> open_libcamera_stream(const SourceSettings& settings);

}  // namespace orbbuf
