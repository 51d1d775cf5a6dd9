// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "common/wire.hpp"

namespace orbbuf {

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
