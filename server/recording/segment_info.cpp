// SPDX-License-Identifier: Apache-2.0
#include "server/recording/segment_info.hpp"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>

#include "common/decimal.hpp"

namespace orbbuf {
namespace {

constexpr std::string_view kSegmentHeader = "epoch,next_sequence,next_drop\n";

}  // namespace

std::string to_csv(const SegmentInfo& segment) {
  return fmt::format("{}{},{},{}\n", kSegmentHeader, segment.epoch, segment.from.next_sequence,
                     segment.from.next_drop);
}

std::optional<SegmentInfo> segment_from_csv(std::string_view text) {
  if (!text.starts_with(kSegmentHeader) || !text.ends_with('\n')) return std::nullopt;
  text.remove_prefix(kSegmentHeader.size());
  if (text.empty()) return std::nullopt;
  text.remove_suffix(1);
  std::array<std::uint64_t, 3> numbers{};
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const auto comma = i + 1 < numbers.size() ? text.find(',') : text.size();
    if (comma == std::string_view::npos) return std::nullopt;
    const auto number = parse_digits(text.substr(0, comma));
    if (!number) return std::nullopt;
    numbers[i] = *number;
    text.remove_prefix(std::min(comma + 1, text.size()));
  }
  return SegmentInfo{numbers[0], {numbers[1], numbers[2]}};
}

}  // namespace orbbuf
