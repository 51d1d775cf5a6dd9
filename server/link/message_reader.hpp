// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
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
                                                   const wire::LatePart& part) {
    const bool is_first = record_.empty();
    if (number != number_ || part.offset != record_.size() ||
        (!is_first && part.record_bytes != record_bytes_)) {
      return wire::Fault{wire::ErrorCode::kUnexpected,
                         fmt::format("late frame {} from byte {} on, not {} from {} on", number,
                                     part.offset, number_, record_.size())};
    }
    const std::uint64_t limit =
        std::max<std::uint64_t>(max_jpeg_bytes_, wire::kMaxItemsBytes) + wire::kMaxLateHeadBytes;
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

 private:
  const std::uint32_t max_jpeg_bytes_;
  std::uint64_t number_ = 0;          // of the frame that comes
  std::uint32_t record_bytes_ = 0;    // of it; known since its first part
  std::vector<std::uint8_t> record_;  // what has come of it
};

/// A message as it came: the header is checked, the body complete but not parsed. A frame's body is
/// in two pieces, as wire::parse_frame() takes it.
struct Message {
  wire::Header header;
  std::array<std::uint8_t, wire::kFrameMetaBytes> meta{};  ///< frames only
  std::vector<std::uint8_t> body;
};

/// Says where the next bytes of a stream belong and when they make a message: the bytes are read
/// into their final place and never copied. Knows no sockets and never asks for bytes of the next
/// message, so there is no read-ahead. Memory grows with the bytes that really come, at most to
/// twice those, whatever a header claims. The first message must be hello, so a peer that has not
/// introduced itself costs a hello's memory at most. Reentrant.
class MessageReader {
 public:
  explicit MessageReader(std::uint32_t max_jpeg_bytes) : max_jpeg_bytes_(max_jpeg_bytes) {}

  /// Where to put the next bytes; never empty, valid until commit().
  std::span<std::uint8_t> space();

  /// `bytes` of space() were filled. True: the message is complete, take() it. After a fault
  /// the stream cannot be read on.
  wire::Parsed<bool> commit(std::size_t bytes);

  Message take();

  bool is_between_messages() const { return part_ == Part::kHeader && filled_ == 0; }

 private:
  enum class Part : std::uint8_t { kHeader, kMeta, kBody };

  wire::Parsed<bool> begin_body();

  const std::uint32_t max_jpeg_bytes_;
  Part part_ = Part::kHeader;
  std::size_t filled_ = 0;  // of the part
  std::size_t body_bytes_ = 0;
  bool is_introduced_ = false;  // the first message is complete
  std::array<std::uint8_t, wire::kHeaderBytes> head_{};
  Message message_;
};

}  // namespace orbbuf
