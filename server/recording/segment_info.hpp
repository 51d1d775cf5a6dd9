// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "common/wire.hpp"

namespace orbbuf {

/// Where a folder stands in its session, if other servers have recorded parts of that: its file
/// `segment.csv`. Without one the folder has the session from its beginning on.
struct SegmentInfo {
  std::uint64_t epoch = 1;
  wire::Position from{};  ///< its first frame and drop record can be these

  bool is_first() const { return epoch == 1; }
  friend bool operator==(const SegmentInfo&, const SegmentInfo&) = default;
};

/// A header and a line: `7,1200,35`.
std::string to_csv(const SegmentInfo& segment);
std::optional<SegmentInfo> segment_from_csv(std::string_view text);

}  // namespace orbbuf
