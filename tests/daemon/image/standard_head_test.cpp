// SPDX-License-Identifier: Apache-2.0
#include "daemon/image/standard_head.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>

#include "common/jpeg.hpp"
#include "testing/restart_jpeg.hpp"

namespace orbbuf {
namespace {

using Bytes = std::vector<std::uint8_t>;

Bytes noise_jpeg(bool is_color) {
  constexpr int kSide = 64, kChannels = 3;
  Bytes pixels(std::size_t{kSide} * kSide * kChannels);
  std::uint32_t random = 1;
  for (auto& value : pixels) {
    random = random * 1664525 + 1013904223;
    value = static_cast<std::uint8_t>(random >> 24U);
  }
  JpegCodec codec;
  const ImageView view{pixels.data(), kSide, kSide, std::size_t{kSide} * kChannels, kChannels};
  return codec.encode(view, 90, is_color).value();
}

/// As a camera sends it. The segments before the scan are those of libjpeg: none has a length
/// beyond the data.
Bytes without_tables(const Bytes& jpeg) {
  Bytes left(jpeg.begin(), jpeg.begin() + 2);
  std::size_t at = 2;
  while (jpeg.at(at + 1) != 0xDA) {
    const std::size_t size = 2U + jpeg.at(at + 2) * 256U + jpeg.at(at + 3);
    const auto begin = jpeg.begin() + static_cast<std::ptrdiff_t>(at);
    if (jpeg[at + 1] != 0xC4) {
      left.insert(left.end(), begin, begin + static_cast<std::ptrdiff_t>(size));
    }
    at += size;
  }
  left.insert(left.end(), jpeg.begin() + static_cast<std::ptrdiff_t>(at), jpeg.end());
  return left;
}

TEST(StandardHead, HasHuffmanTables) {
  for (const bool is_color : {false, true}) {
    const Bytes whole = noise_jpeg(is_color);
    const Bytes bare = without_tables(whole);
    ASSERT_LT(bare.size(), whole.size());
    const Bytes mended = with_standard_head(bare);
    constexpr std::size_t kAllFour = 432;  // K.3 to K.6 in four segments
    EXPECT_EQ(mended.size(), bare.size() + kAllFour);
    EXPECT_EQ(JpegCodec().decode_gray(mended, 1).value().pixels,
              JpegCodec().decode_gray(whole, 1).value().pixels);
    EXPECT_EQ(with_standard_head(mended), mended);
  }
}

TEST(StandardHead, BytesBetweenSegmentsAreLeftOut) {
  const Bytes whole = noise_jpeg(true);
  const Bytes with_zeros = test::with_zeros_in_head(whole, 600);
  EXPECT_EQ(with_standard_head(with_zeros), whole);
  EXPECT_EQ(with_standard_head(test::with_zeros_in_head(without_tables(whole), 3)),
            with_standard_head(without_tables(whole)));
  Bytes filled = whole;
  filled.insert(filled.begin() + 2, {0xFF, 0x00, 0xFF, 0xFF});
  EXPECT_EQ(with_standard_head(filled), whole);
}

TEST(StandardHead, AnImageThatHasOneStaysAsItIs) {
  const Bytes whole = noise_jpeg(true);
  EXPECT_EQ(with_standard_head(whole), whole);
}

TEST(StandardHead, ABrokenImageStaysAsItIs) {
  const Bytes bare = without_tables(noise_jpeg(false));
  constexpr std::array<std::uint8_t, 2> kScan = {0xFF, 0xDA};
  const auto scan =
      std::search(bare.begin(), bare.end(), kScan.begin(), kScan.end()) - bare.begin();
  ASSERT_LT(scan + 10, std::ssize(bare));
  for (std::ptrdiff_t size = 0; size < scan + 10; ++size) {  // up to the scan's head, of 10 bytes
    const Bytes cut(bare.begin(), bare.begin() + size);
    EXPECT_EQ(with_standard_head(cut), cut) << size;
  }
}

}  // namespace
}  // namespace orbbuf
