// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "common/frame.hpp"

namespace orbbuf {

/// Why a captured frame was not delivered. The numbers are the protocol's (docs/protocol.md).
enum class DropReason : std::uint8_t {
  kPolicy = 1,    ///< the buffer was full and the policy chose this frame
  kBusy = 2,      ///< a newer frame came before this one could be encoded
  kFailed = 3,    ///< the image could not be read or encoded
  kShutdown = 4,  ///< still undelivered when the daemon had to stop
  kRefused = 5,   ///< larger than the server accepts: wire::Welcome::max_frame_bytes
  /// Sent and not acknowledged when the daemon had to stop (the server may have it), or captured by
  /// a daemon that was killed, which left no more than its number.
  kUnknown = 6,
  kLost = 7,  ///< acknowledged, but the server does not have it any more
};

/// DropRecord::similarity if the neighbours were not compared.
inline constexpr std::uint16_t kUnknownSimilarity = 0xFFFF;

/// Captured frames that will not be delivered, named: one, or a run of numbers without a gap.
struct DropRecord {
  Sequence sequence = 0;  ///< the first
  std::int64_t capture_time_ns = 0;
  DropReason reason = DropReason::kPolicy;
  /// M of the two neighbours of a single frame at the time of the drop. Not kept in lists.
  std::uint16_t similarity = kUnknownSimilarity;
  std::uint64_t frames = 1;               ///< at least 1; the last number is below 2^64 - 1
  std::int64_t last_capture_time_ns = 0;  ///< of the last one, if there are several

  Sequence end() const { return sequence + frames; }
  /// Of the frame `number` of them; between the first and the last it is interpolated.
  std::int64_t capture_time_of(Sequence number) const;
  /// Those of its frames from `begin` to before `end`, at least one.
  DropRecord part(Sequence begin, Sequence end) const;

  friend bool operator==(const DropRecord&, const DropRecord&) = default;
};

/// The first line of a drop record file, without the line end: `sequence,reason,capture_time_s`.
inline constexpr std::string_view kDropCsvHeader = "sequence,reason,capture_time_s";

/// The most frames that a list, a line for each, names as dropped of a session of which `frames`
/// are here: the numbers are the robot's word, and a stranger's one record may name 2^63.
constexpr std::uint64_t most_drop_lines(std::uint64_t frames) {
  return std::min<std::uint64_t>(1'000'000, 1000 + 100 * std::min<std::uint64_t>(frames, 10'000));
}

/// Leaves the first `most` frames that the records name. True: there were more.
bool cut(std::vector<DropRecord>& records, std::uint64_t most);

/// One word: `policy`, `busy`, `failed`, `shutdown`, `refused`, `unknown` or `lost`; empty for any
/// other number.
std::string_view to_string(DropReason reason);

/// A line for each frame: `17,policy,1.633012000`. The ends of the lines are in it.
std::string to_csv(const DropRecord& record);

}  // namespace orbbuf
