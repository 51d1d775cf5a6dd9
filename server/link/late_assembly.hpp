// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/core.h>

#include <cstdint>
#include <optional>
#include <utility>
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

 private:
  const std::uint32_t max_jpeg_bytes_;
  std::uint64_t number_ = 0;          // of the frame that comes
  std::uint32_t record_bytes_ = 0;    // of it; known since its first part
  std::vector<std::uint8_t> record_;  // what has come of it
};

inline wire::Parsed<std::optional<wire::LateFrame>> LateAssembly::add(std::uint64_t number,
                                                                      const wire::LatePart& part) {
  const bool is_first = record_.empty();
  if (number != number_ || part.offset != record_.size() ||
      (!is_first && part.record_bytes != record_bytes_)) {
    return wire::Fault{wire::ErrorCode::kUnexpected,
                       fmt::format("late frame {} from byte {} on, not {} from {} on", number,
                                   part.offset, number_, record_.size())};
  }
  const std::uint64_t limit = std::uint64_t{max_jpeg_bytes_} + wire::kMaxLateHeadBytes;
  if (part.record_bytes > limit) {
    return wire::Fault{
        wire::ErrorCode::kTooLarge,
        fmt::format("late frame of {} bytes is over the limit of {}", part.record_bytes, limit)};
  }
  record_bytes_ = part.record_bytes;
  record_.insert(record_.end(), part.bytes.begin(), part.bytes.end());
  if (record_.size() < record_bytes_) return std::optional<wire::LateFrame>();
  auto frame = wire::parse_late_record(std::exchange(record_, {}));
  if (!frame) return std::move(frame).error();
  ++number_;
  return std::optional(std::move(frame).value());
}

}  // namespace orbbuf
