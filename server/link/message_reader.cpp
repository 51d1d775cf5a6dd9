// SPDX-License-Identifier: Apache-2.0
#include "server/link/message_reader.hpp"

namespace orbbuf {
namespace {

constexpr std::size_t kFirstStepBytes = 131072;  // most frames need no second one

}  // namespace

/// A body's room doubles as it fills, so that a header's claim alone costs one step at most.
std::span<std::uint8_t> MessageReader::space() {
  switch (part_) {
    case Part::kHeader:
      return std::span(head_).subspan(filled_);
    case Part::kMeta:
      return std::span(message_.meta).subspan(filled_);
    case Part::kBody:
      break;
  }
  if (filled_ == message_.body.size()) {
    message_.body.resize(std::min(body_bytes_, std::max(2 * filled_, kFirstStepBytes)));
  }
  return std::span(message_.body).subspan(filled_);
}

wire::Parsed<bool> MessageReader::commit(std::size_t bytes) {
  filled_ += bytes;
  switch (part_) {
    case Part::kHeader:
      return filled_ < head_.size() ? false : begin_body();
    case Part::kMeta:
      if (filled_ == message_.meta.size()) {
        part_ = Part::kBody;
        filled_ = 0;
      }
      return false;
    case Part::kBody:
      break;
  }
  return filled_ == body_bytes_;
}

wire::Parsed<bool> MessageReader::begin_body() {
  auto header = wire::parse_header(head_, max_jpeg_bytes_);
  if (!header) return std::move(header).error();
  if (!is_introduced_ && header.value().type != wire::Type::kHello) {
    return wire::Fault{wire::ErrorCode::kUnexpected,
                       fmt::format("{} before hello", to_string(header.value().type))};
  }
  message_.header = header.value();
  const bool is_frame = message_.header.type == wire::Type::kFrame;
  part_ = is_frame ? Part::kMeta : Part::kBody;
  filled_ = 0;
  body_bytes_ = message_.header.body_bytes - (is_frame ? wire::kFrameMetaBytes : 0);
  return body_bytes_ == 0;
}

Message MessageReader::take() {
  part_ = Part::kHeader;
  filled_ = 0;
  is_introduced_ = true;
  return std::exchange(message_, {});
}

}  // namespace orbbuf
