// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>

#include "common/error.hpp"
#include "daemon/capture/camera_unpack.hpp"

namespace orbbuf {

/// A filled buffer, lent by the driver until it is given back.
struct CameraBuffer {
  std::uint32_t index = 0;
  std::uint32_t sequence = 0;          ///< the driver's number of the frame
  std::int64_t stamp_ns = 0;           ///< when, by the monotonic clock; 0: the driver does not say
  std::uint32_t exposure_ns = 0;       ///< 0: the driver does not say
  bool is_corrupt = false;             ///< by the driver's own word
  std::span<const std::uint8_t> data;  ///< the part that was filled
};

/// A camera that films, from construction to destruction, into buffers of its driver. Once it has
/// failed it stays so: another one is opened in its place (CameraSource). Thread-bound.
class CameraStream {
 public:
  CameraStream() = default;
  virtual ~CameraStream() = default;
  CameraStream(const CameraStream&) = delete;
  CameraStream& operator=(const CameraStream&) = delete;

  /// To poll: readable when there is something to borrow, or the stream has failed.
  virtual int fd() const = 0;

  virtual const CameraMode& mode() const = 0;

  /// Which camera, and what it says of itself: `/dev/video0 (vivid, platform:vivid-000)`.
  virtual std::string description() const = 0;

  /// The oldest filled buffer; nothing if there is none yet. An error is the end of the stream. One
  /// buffer at a time is lent, so that the others, at least two, are the driver's to fill.
  virtual Result<std::optional<CameraBuffer>> borrow() = 0;

  /// Ends the loan. An error is the end of the stream.
  virtual std::optional<Error> give_back(const CameraBuffer& buffer) = 0;
};

/// No such camera is there: unplugged, or not plugged in yet.
class CameraGone : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Opens, sets up and starts a camera. Throws CameraGone, or std::runtime_error saying what failed,
/// or that the camera does not do as asked, with what it offers.
using OpenCamera = std::function<std::unique_ptr<CameraStream>()>;

}  // namespace orbbuf
