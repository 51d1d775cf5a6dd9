// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "common/wire.hpp"

namespace orbbuf {

/// Puts the late frames of one connection together from their parts. Memory: twice the bytes that
/// have come of one frame, whatever a message claims. Reentrant.
class LateAssembly {
 public:
  explicit LateAssembly(std::uint32_t max_jpeg_bytes) : max_jpeg_bytes_(max_jpeg_bytes) {}

  /// The frame, if this was its last part. A fault, after which no part may follow, if the part is
  /// not the next one, the frame is too large, or the parts are no frame.
  wire::Parsed<std::optional<wire::LateFrame>> add(std::uint64_t number,
                                                   const wire::LatePart& part);

  /// Of the frame that comes.
  std::uint64_t number() const { return number_; }

 private:
  const std::uint32_t max_jpeg_bytes_;
  std::uint64_t number_ = 0;          // of the frame that comes
  std::uint32_t record_bytes_ = 0;    // of it; known since its first part
  std::vector<std::uint8_t> record_;  // what has come of it
};

}  // namespace orbbuf
