// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace orbbuf {

/// How large the segments of the next connection may be, on a path that may lose large packets
/// without a word (an MTU black hole): small messages arrive there, so that the server welcomes the
/// robot, and no frame ever does. After two connections in a row that stalled before a segment of
/// full size was acknowledged, segments are of 1200 bytes; after three, of 536. Reentrant.
class SegmentSize {
 public:
  /// A connection was welcome, when its server had acknowledged so many bytes.
  void on_welcome(std::uint64_t acked_bytes) { acked_at_welcome_ = acked_bytes; }
  /// That connection stalled.
  void on_stall(std::uint64_t acked_bytes) {
    if (acked_bytes - acked_at_welcome_ < kSmall) return on_nothing_large();
    if (failures_ < kPatience) failures_ = 0;
  }
  /// A connection ended in the middle of the TLS handshake, whose certificates are large.
  void on_nothing_large() { ++failures_; }
  /// The path may be another.
  void reset() { failures_ = 0; }

  /// In bytes; 0: as the interface has it.
  int limit() const { return failures_ < kPatience ? 0 : failures_ == kPatience ? kSmall : kLeast; }

 private:
  static constexpr int kPatience = 2;  // an outage may begin just after a welcome
  static constexpr int kSmall = 1200;
  static constexpr int kLeast = 536;

  std::uint64_t acked_at_welcome_ = 0;
  int failures_ = 0;
};

}  // namespace orbbuf
