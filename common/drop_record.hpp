// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/frame.hpp"

namespace orbbuf {

/// Why a captured frame was not delivered. The numbers are the protocol's (docs/protocol.md), all
/// but kLate's.
enum class DropReason : std::uint8_t {
  kPolicy = 1,    ///< the buffer was full and the policy chose this frame
  kBusy = 2,      ///< a newer frame came before this one could be encoded
  kFailed = 3,    ///< the image could not be read or encoded
  kShutdown = 4,  ///< still undelivered when the daemon had to stop
  kRefused = 5,   ///< larger than the server accepts: wire::Welcome::max_frame_bytes
  kUnknown =
      6,        ///< sent and not acknowledged when the daemon had to stop (the server may have it),
                ///< or captured by a daemon that was killed, which left no more than its number
  kLost = 7,    ///< acknowledged, but the server does not have it any more
  kLate = 255,  ///< files only: passed over live, and arrived later; late.csv says when
};

/// DropRecord::similarity if the neighbours were not compared.
inline constexpr std::uint16_t kUnknownSimilarity = 0xFFFF;

/// A captured frame that will not be delivered, named.
struct DropRecord {
  Sequence sequence = 0;
  std::int64_t capture_time_ns = 0;
  DropReason reason = DropReason::kPolicy;
  /// M of its two neighbours at the time of the drop. Not kept in files.
  std::uint16_t similarity = kUnknownSimilarity;

  friend bool operator==(const DropRecord&, const DropRecord&) = default;
};

/// The first line of a drop record file, without the line end: `sequence,reason,capture_time_s`.
inline constexpr std::string_view kDropCsvHeader = "sequence,reason,capture_time_s";

/// One word: `policy`, `busy`, `failed`, `shutdown`, `refused`, `unknown`, `lost` or `late`.
std::string_view to_string(DropReason reason);

/// One line of a drop record file, without the line end: `17,policy,1.633012000`.
std::string to_csv(const DropRecord& record);
/// to_csv() read back; nothing if it is not that.
std::optional<DropRecord> drop_from_csv(std::string_view line);

}  // namespace orbbuf
