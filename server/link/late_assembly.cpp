// SPDX-License-Identifier: Apache-2.0
#include "server/link/late_assembly.hpp"

#include <fmt/core.h>

#include <utility>

namespace orbbuf {

using wire::ErrorCode;
using wire::Fault;

wire::Parsed<std::optional<wire::LateFrame>> LateAssembly::add(std::uint64_t number,
                                                               const wire::LatePart& part) {
  const bool is_first = record_.empty();
  if (number != number_ || part.offset != record_.size() ||
      (!is_first && part.record_bytes != record_bytes_)) {
    return Fault{ErrorCode::kUnexpected,
                 fmt::format("late frame {} from byte {} on, not {} from {} on", number,
                             part.offset, number_, record_.size())};
  }
  const std::uint64_t limit = std::uint64_t{max_jpeg_bytes_} + wire::kMaxLateHeadBytes;
  if (part.record_bytes > limit) {
    return Fault{ErrorCode::kTooLarge, fmt::format("late frame of {} bytes is over the limit of {}",
                                                   part.record_bytes, limit)};
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
