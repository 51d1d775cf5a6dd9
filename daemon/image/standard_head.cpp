// SPDX-License-Identifier: Apache-2.0
#include "daemon/image/standard_head.hpp"

#include <array>
#include <cstddef>
#include <stdexcept>

#include "common/jpeg.hpp"

namespace orbbuf {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr std::uint8_t kStart = 0xD8, kBaseline = 0xC0, kExtended = 0xC1, kHuffmanTables = 0xC4,
                       kScan = 0xDA;

/// The next segment of a JPEG's head, with its marker and its length; taken off `rest`, with what
/// is before it. Empty: there is none.
Bytes take_segment(Bytes& rest) {
  constexpr std::size_t kMarkerAndLength = 4;
  const auto has_no_segment = [](std::uint8_t code) {
    return code <= 1 || (code >= 0xD0 && code <= kStart) || code == 0xFF;
  };
  while (rest.size() >= kMarkerAndLength && (rest[0] != 0xFF || has_no_segment(rest[1]))) {
    rest = rest.subspan(1);
  }
  if (rest.size() < kMarkerAndLength) return {};
  const std::size_t size = 2U + (std::size_t{rest[2]} << 8U) + rest[3];
  if (size < kMarkerAndLength || size > rest.size()) return {};
  const Bytes segment = rest.first(size);
  rest = rest.subspan(size);
  return segment;
}

void append(Bytes segment, std::vector<std::uint8_t>& to) {
  to.insert(to.end(), segment.begin(), segment.end());
}

/// The segments with tables of a colour image that JpegCodec encodes: it writes the standard ones.
std::vector<std::uint8_t> standard_tables() {
  constexpr std::array<std::uint8_t, 3> kPixel{};
  const auto jpeg = JpegCodec().encode({kPixel.data(), 1, 1, kPixel.size(), 3}, 80, true);
  if (!jpeg) throw std::runtime_error(jpeg.error().text);
  std::vector<std::uint8_t> tables;
  Bytes rest = jpeg.value();
  for (Bytes segment; !(segment = take_segment(rest)).empty() && segment[1] != kScan;) {
    if (segment[1] == kHuffmanTables) append(segment, tables);
  }
  return tables;
}

}  // namespace

std::vector<std::uint8_t> with_standard_head(Bytes jpeg) {
  static const std::vector<std::uint8_t> tables = standard_tables();
  std::vector<std::uint8_t> copy = {0xFF, kStart};
  copy.reserve(jpeg.size() + tables.size());
  bool is_baseline = false;
  bool has_tables = false;
  Bytes rest = jpeg;
  for (Bytes segment; !(segment = take_segment(rest)).empty();) {
    if (segment[1] == kHuffmanTables) has_tables = true;
    if (segment[1] == kBaseline || segment[1] == kExtended) is_baseline = true;
    if (segment[1] == kScan && is_baseline && !has_tables) append(tables, copy);
    append(segment, copy);
    if (segment[1] != kScan) continue;
    append(rest, copy);
    return copy;
  }
  return {jpeg.begin(), jpeg.end()};
}

}  // namespace orbbuf
