// SPDX-License-Identifier: Apache-2.0
#include "daemon/image/huffman_tables.hpp"

#include <array>
#include <cstddef>
#include <stdexcept>

#include "common/jpeg.hpp"

namespace orbbuf {
namespace {

using Bytes = std::span<const std::uint8_t>;

constexpr std::uint8_t kBaseline = 0xC0, kExtended = 0xC1, kHuffmanTables = 0xC4, kScan = 0xDA;

/// A segment of a JPEG's head with its marker, FF and the code; empty where there is none.
Bytes segment_at(Bytes jpeg, std::size_t at) {
  constexpr std::size_t kMarkerAndLength = 4;
  if (at + kMarkerAndLength > jpeg.size() || jpeg[at] != 0xFF) return {};
  const std::size_t size = 2U + (std::size_t{jpeg[at + 2]} << 8U) + jpeg[at + 3];
  return size < kMarkerAndLength || size > jpeg.size() - at ? Bytes() : jpeg.subspan(at, size);
}

/// The segments with tables of a colour image that TurboJPEG encodes: it writes the standard ones.
std::vector<std::uint8_t> standard_tables() {
  constexpr std::array<std::uint8_t, 3> kPixel{};
  const auto jpeg = JpegCodec().encode({kPixel.data(), 1, 1, kPixel.size(), 3}, 80, true);
  if (!jpeg) throw std::runtime_error(jpeg.error().text);
  std::vector<std::uint8_t> tables;
  std::size_t at = 2;
  for (Bytes segment; !(segment = segment_at(jpeg.value(), at)).empty(); at += segment.size()) {
    if (segment[1] == kScan) break;
    if (segment[1] == kHuffmanTables) tables.insert(tables.end(), segment.begin(), segment.end());
  }
  return tables;
}

}  // namespace

std::vector<std::uint8_t> with_huffman_tables(Bytes jpeg) {
  std::vector<std::uint8_t> copy(jpeg.begin(), jpeg.end());
  bool is_baseline = false;
  std::size_t at = 2;
  for (Bytes segment; !(segment = segment_at(jpeg, at)).empty(); at += segment.size()) {
    if (segment[1] == kHuffmanTables) return copy;
    if (segment[1] == kBaseline || segment[1] == kExtended) is_baseline = true;
    if (segment[1] == kScan) break;
  }
  if (!is_baseline || segment_at(jpeg, at).empty()) return copy;
  static const std::vector<std::uint8_t> tables = standard_tables();
  copy.insert(copy.begin() + static_cast<std::ptrdiff_t>(at), tables.begin(), tables.end());
  return copy;
}

}  // namespace orbbuf
