// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/frame.hpp"

namespace orbbuf {

/// Why a captured frame was not delivered. The numbers are the protocol's (docs/protocol.md).
enum class DropReason : std::uint8_t {
  kPolicy = 1,    ///< the buffer was full and the policy chose this frame
  kBusy = 2,      ///< a newer frame came before this one could be encoded
  kFailed = 3,    ///< the image could not be read or encoded
  kShutdown = 4,  ///< still undelivered when the daemon had to stop
};

/// DropRecord::similarity where nobody has compared the neighbours.
inline constexpr std::uint16_t kUnknownSimilarity = 0xFFFF;

/// A captured frame that will not be delivered, named.
struct DropRecord {
  Sequence sequence = 0;
  std::int64_t capture_time_ns = 0;
  DropReason reason = DropReason::kPolicy;
  /// M of the two frames between which it was, when it went. Not kept in files.
  std::uint16_t similarity = kUnknownSimilarity;

  friend bool operator==(const DropRecord&, const DropRecord&) = default;
};

/// The first line of a drop record file, without the line end: `sequence,reason,capture_time_s`.
inline constexpr std::string_view kDropCsvHeader = "sequence,reason,capture_time_s";

/// One word: `policy`, `busy`, `failed` or `shutdown`.
std::string_view to_string(DropReason reason);

/// One line of a drop record file, without the line end: `17,policy,1.633012000`.
std::string to_csv(const DropRecord& record);
/// to_csv() read back; nothing if it is not that.
std::optional<DropRecord> drop_from_csv(std::string_view line);

/// Whole seconds, rounded down, and the nanoseconds from there, 0 to 999,999,999. Of any time.
struct SplitTime {
  std::int64_t seconds = 0;
  std::int64_t nanoseconds = 0;

  friend bool operator==(const SplitTime&, const SplitTime&) = default;
};
SplitTime split_seconds(std::int64_t time_ns);

/// Exact decimal seconds with nine digits after the point; negative times keep their sign.
std::string format_seconds(std::int64_t time_ns);
/// format_seconds() read back; nothing if it is not that.
std::optional<std::int64_t> parse_seconds(std::string_view text);

}  // namespace orbbuf
