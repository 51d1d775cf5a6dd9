// SPDX-License-Identifier: Apache-2.0
#include "common/libjpeg.hpp"

#include <gmock/gmock.h>

#include <array>
#include <functional>

#include "common/jpeg.hpp"

namespace orbbuf {
namespace {

using testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;

/// 32x32 pixels of `components`, as `change` says.
Bytes encode(int components, J_COLOR_SPACE space,
             const std::function<void(jpeg_compress_struct&)>& change) {
  Libjpeg libjpeg("");
  Bytes row(std::size_t{32} * 4);
  for (std::size_t i = 0; i < row.size(); ++i) row[i] = static_cast<std::uint8_t>(i * i);
  const bool is_done = libjpeg.run([&] {
    jpeg_compress_struct& out = libjpeg.out;
    out.image_width = out.image_height = 32;
    out.input_components = components;
    out.in_color_space = space;
    jpeg_set_defaults(&out);
    change(out);
    jpeg_start_compress(&out, TRUE);
    JSAMPROW pixels = row.data();
    while (out.next_scanline < 32) jpeg_write_scanlines(&out, &pixels, 1);
    jpeg_finish_compress(&out);
  });
  EXPECT_TRUE(is_done) << libjpeg.why.data();
  return {libjpeg.written().begin(), libjpeg.written().end()};
}

std::string error_of(const Bytes& jpeg) {
  const auto info = JpegCodec().inspect(jpeg);
  return info ? "" : info.error().text;
}

TEST(Libjpeg, WhatIsNeitherGrayNorYcbcrIsRefused) {
  const auto as_it_is = [](jpeg_compress_struct& /*out*/) {};
  EXPECT_EQ(error_of(encode(1, JCS_GRAYSCALE, as_it_is)), "");
  EXPECT_EQ(error_of(encode(3, JCS_RGB, as_it_is)), "");
  const auto in_rgb = [](jpeg_compress_struct& out) { jpeg_set_colorspace(&out, JCS_RGB); };
  EXPECT_EQ(error_of(encode(3, JCS_RGB, in_rgb)),
            "cannot read a JPEG: it is neither gray nor YCbCr, and has 3 components");
  EXPECT_EQ(error_of(encode(4, JCS_CMYK, as_it_is)),
            "cannot read a JPEG: it is neither gray nor YCbCr, and has 4 components");
}

TEST(Libjpeg, ArithmeticCodesAreRefused) {
  const auto arithmetic = [](jpeg_compress_struct& out) { out.arith_code = TRUE; };
  EXPECT_EQ(error_of(encode(1, JCS_GRAYSCALE, arithmetic)),
            "cannot read a JPEG: it has arithmetic codes; only Huffman codes are read");
}

TEST(Libjpeg, OtherThanEightBitsASampleAreRefused) {
  Bytes jpeg = encode(1, JCS_GRAYSCALE, [](jpeg_compress_struct& /*out*/) {});
  constexpr std::array<std::uint8_t, 2> kFrame = {0xFF, 0xC0};
  const auto frame = std::search(jpeg.begin(), jpeg.end(), kFrame.begin(), kFrame.end());
  ASSERT_NE(frame, jpeg.end());
  frame[4] = 12;
  EXPECT_THAT(error_of(jpeg), HasSubstr("12"));
}

/// Where libjpeg misses nothing: all that it has is whole.
TEST(Libjpeg, DataThatEndBetweenTwoScansAreAnError) {
  std::array<jpeg_scan_info, 3> scans{};
  for (int i = 0; i < 3; ++i) scans[static_cast<std::size_t>(i)] = {1, {i}, 0, 63, 0, 0};
  const auto one_each = [&](jpeg_compress_struct& out) {
    out.scan_info = scans.data();
    out.num_scans = 3;
  };
  constexpr std::array<std::uint8_t, 2> kScan = {0xFF, 0xDA};
  for (const bool is_progressive : {false, true}) {
    Bytes jpeg = encode(3, JCS_RGB, [&](jpeg_compress_struct& out) {
      is_progressive ? jpeg_simple_progression(&out) : one_each(out);
    });
    EXPECT_EQ(error_of({jpeg.begin(), jpeg.end() - 2}), "");
    jpeg.erase(std::find_end(jpeg.begin(), jpeg.end(), kScan.begin(), kScan.end()), jpeg.end());
    EXPECT_EQ(error_of(jpeg), "cannot read a JPEG: Premature end of JPEG file");
  }
}

TEST(Libjpeg, AnOutputOfAnySizeHasRoom) {
  JpegCodec codec;
  Bytes noise(std::size_t{1024} * 1024);
  std::uint32_t random = 1;
  for (auto& value : noise)
    value = static_cast<std::uint8_t>((random = random * 1664525 + 1013904223) >> 24U);
  const auto jpeg = codec.encode({noise.data(), 1024, 1024, 1024, 1}, 100, false);
  ASSERT_TRUE(jpeg);
  EXPECT_GT(jpeg.value().size(), noise.size());
  EXPECT_TRUE(codec.decode_gray(jpeg.value(), 1));
}

}  // namespace
}  // namespace orbbuf
