// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "daemon/capture/make_source.hpp"
#include "daemon/capture/v4l2_device.hpp"
#include "daemon/capture/v4l2_unpack.hpp"

namespace orbbuf {

/// A filled buffer, lent by the driver until it is given back.
struct CameraBuffer {
  std::uint32_t index = 0;
  std::uint32_t sequence = 0;          ///< the driver's number of the frame
  std::int64_t stamp_ns = 0;           ///< when, by the monotonic clock; 0: the driver does not say
  bool is_corrupt = false;             ///< by the driver's own word
  std::span<const std::uint8_t> data;  ///< the part that was filled
};

/// A camera that films, from construction to destruction: through buffers of the driver that are
/// mapped here. Thread-bound.
class V4l2Stream {
 public:
  /// Opens, sets up and starts the camera of `[source]`. Throws std::runtime_error saying what
  /// failed, or that the driver does not do as asked, with what it offers.
  explicit V4l2Stream(const SourceSettings& settings);
  ~V4l2Stream();
  V4l2Stream(const V4l2Stream&) = delete;
  V4l2Stream& operator=(const V4l2Stream&) = delete;

  const CameraMode& mode() const { return mode_; }
  const V4l2Device& device() const { return device_; }

  /// The oldest filled buffer; nothing if there is none yet: poll device().fd(). An error is the
  /// end of the stream. One buffer at a time is lent, so that the others, at least two, are the
  /// driver's to fill.
  Result<std::optional<CameraBuffer>> borrow();

  /// Ends the loan. An error is the end of the stream.
  std::optional<Error> give_back(const CameraBuffer& buffer);

 private:
  void set_format(const SourceSettings& settings);
  void set_rate(double fps);
  void map_buffers();

  /// One buffer's memory, unmapped at the end.
  class Mapping {
   public:
    Mapping(void* begin, std::size_t size) : begin_(begin), size_(size) {}
    Mapping(Mapping&& other) noexcept;
    Mapping& operator=(Mapping&&) = delete;
    ~Mapping();
    std::span<const std::uint8_t> bytes() const;

   private:
    void* begin_;
    std::size_t size_;
  };

  V4l2Device device_;
  CameraMode mode_;
  std::vector<Mapping> buffers_;
};

}  // namespace orbbuf
