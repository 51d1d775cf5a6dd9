// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cerrno>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <system_error>

#include "common/error.hpp"
#include "daemon/capture/camera_unpack.hpp"

namespace orbbuf {

/// Why a camera's driver failed, by its errno value: the system's text, which for ENOSPC would mean
/// a full disk.
inline std::string driver_error(int error) {
  if (error != ENOSPC) return std::generic_category().message(error);
  return "the USB bus has no bandwidth left for this camera: plug it into a port of another bus, "
         "or set source.format = \"MJPG\", a smaller source.width and source.height, or a lower "
         "source.fps";
}

/// A filled buffer, lent by the driver until it is given back.
struct CameraBuffer {
  std::uint32_t index = 0;
  std::uint32_t sequence = 0;          ///< the driver's number of the frame
  std::int64_t stamp_ns = 0;           ///< when, by the monotonic clock; 0: the driver does not say
  std::uint32_t exposure_ns = 0;       ///< 0: the driver does not say
  bool is_corrupt = false;             ///< the driver marked it
  std::span<const std::uint8_t> data;  ///< the part that was filled
  ChromaPlanes chroma;                 ///< empty: of one plane, or within `data`
};

/// A camera that captures into its driver's buffers from construction to destruction. A stream that
/// has failed does not recover: CameraSource opens a new one. Thread-bound.
class CameraStream {
 public:
  CameraStream() = default;
  virtual ~CameraStream() = default;
  CameraStream(const CameraStream&) = delete;
  CameraStream& operator=(const CameraStream&) = delete;

  /// To poll: readable when there is something to borrow, or the stream has failed.
  virtual int fd() const = 0;

  virtual const CameraMode& mode() const = 0;

  /// Which camera, and the name that it reports: `/dev/video0 (vivid, platform:vivid-000)`.
  virtual std::string description() const = 0;

  /// The command that resets the camera's USB port; empty: it has none, or it is not known.
  virtual std::string reset_command() const { return ""; }

  /// The oldest filled buffer; nothing if there is none yet. An error is the end of the stream. One
  /// buffer at a time is lent, so that the others, at least two, are the driver's to fill.
  virtual Result<std::optional<CameraBuffer>> borrow() = 0;

  /// Ends the loan. An error is the end of the stream.
  virtual std::optional<Error> give_back(const CameraBuffer& buffer) = 0;
};

/// The camera is not present: unplugged, or not plugged in yet.
class CameraGone : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Opens, configures and starts a camera. Throws CameraGone, or std::runtime_error with what failed
/// or which setting the camera does not offer.
using OpenCamera = std::function<std::unique_ptr<CameraStream>()>;

}  // namespace orbbuf
