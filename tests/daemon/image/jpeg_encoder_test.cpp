// SPDX-License-Identifier: Apache-2.0
#include "daemon/image/jpeg_encoder.hpp"

#include <gmock/gmock.h>

#include <cstdlib>

#include "common/libjpeg.hpp"
#include "common/wire.hpp"
#include "daemon/capture/make_source.hpp"
#include "testing/restart_jpeg.hpp"

namespace orbbuf {
namespace {

using testing::HasSubstr;

RawFrame scene_frame(bool color = false) {
  SourceSettings settings;
  settings.width_px = 160;
  settings.height_px = 120;
  settings.color = color;
  settings.realtime = false;
  auto frame = *make_source(settings)->next({});
  frame.capture_time_ns = 1'305'031'102'175'304'000;
  frame.exposure_ns = 10'000'000;
  return frame;
}

RawFrame jpeg_frame(std::span<const std::uint8_t> jpeg) {
  RawFrame frame;
  frame.format = PixelFormat::kJpeg;
  frame.data = jpeg;
  return frame;
}

std::string error_of(JpegEncoder& encoder, const RawFrame& raw) {
  auto frame = encoder.encode(raw, 0);
  return frame ? "" : frame.error().text;
}

TEST(JpegEncoder, GrayPixelsBecomeAGrayJpegThatLooksLikeThem) {
  const auto raw = scene_frame();
  const auto frame = JpegEncoder({}).encode(raw, 42);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame.value().sequence, 42U);
  EXPECT_EQ(frame.value().capture_time_ns, raw.capture_time_ns);
  EXPECT_EQ(frame.value().exposure_ns, raw.exposure_ns);
  EXPECT_EQ(frame.value().width_px, 160);
  EXPECT_EQ(frame.value().height_px, 120);
  EXPECT_EQ(frame.value().jpeg_crc, wire::crc32(frame.value().jpeg));

  JpegCodec codec;
  EXPECT_TRUE(codec.inspect(frame.value().jpeg).value().is_gray);
  const auto decoded = codec.decode_gray(frame.value().jpeg, 1);
  ASSERT_TRUE(decoded);
  const auto& pixels = decoded.value().pixels;
  ASSERT_EQ(pixels.size(), raw.data.size());
  std::int64_t difference = 0;
  for (std::size_t i = 0; i < pixels.size(); ++i) difference += std::abs(pixels[i] - raw.data[i]);
  EXPECT_LT(difference, 8 * static_cast<std::int64_t>(pixels.size()));
}

TEST(JpegEncoder, AFrameSaysItsQualityWhichMayChange) {
  JpegEncoder encoder({.quality = 70});
  const auto first = encoder.encode(scene_frame(), 0);
  encoder.set_quality(20);
  const auto second = encoder.encode(scene_frame(), 1);
  ASSERT_TRUE(first && second);
  EXPECT_EQ(first.value().quality, 70);
  EXPECT_EQ(second.value().quality, 20);
  EXPECT_LT(second.value().jpeg.size(), first.value().jpeg.size());
  EXPECT_EQ(encoder.encode(jpeg_frame(first.value().jpeg), 2).value().quality, 0);
}

TEST(JpegEncoder, ColourIsKeptOnlyWhereAskedFor) {
  const auto raw = scene_frame(true);
  JpegCodec codec;
  const auto in_gray = JpegEncoder({}).encode(raw, 0);
  const auto in_color = JpegEncoder({.quality = 80, .color = true}).encode(raw, 0);
  ASSERT_TRUE(in_gray && in_color);
  EXPECT_TRUE(codec.inspect(in_gray.value().jpeg).value().is_gray);
  EXPECT_FALSE(codec.inspect(in_color.value().jpeg).value().is_gray);
}

/// One colour all over, of odd size.
RawFrame yuv420_frame(std::uint8_t luma, std::uint8_t blue, std::uint8_t red) {
  RawFrame frame;
  frame.width_px = 37;
  frame.height_px = 21;
  const Yuv420Layout layout(frame.width_px, frame.height_px);
  auto planes = std::make_shared<std::vector<std::uint8_t>>(layout.luma_bytes(), luma);
  planes->insert(planes->end(), layout.chroma_bytes(), blue);
  planes->insert(planes->end(), layout.chroma_bytes(), red);
  frame.format = PixelFormat::kYuv420;
  frame.stride_bytes = 2 * layout.columns;
  frame.data = *planes;
  frame.lease = std::move(planes);
  return frame;
}

/// Red, green and blue of each pixel.
std::vector<std::uint8_t> decode_rgb(const EncodedFrame& frame) {
  std::vector<std::uint8_t> pixels(std::size_t{3} * frame.width_px * frame.height_px);
  Libjpeg libjpeg("");
  EXPECT_TRUE(libjpeg.run([&] {
    libjpeg.read_header(frame.jpeg);
    jpeg_start_decompress(&libjpeg.in);
    while (libjpeg.in.output_scanline < libjpeg.in.output_height) {
      JSAMPROW row = &pixels[std::size_t{3} * frame.width_px * libjpeg.in.output_scanline];
      jpeg_read_scanlines(&libjpeg.in, &row, 1);
    }
  }));
  return pixels;
}

TEST(JpegEncoder, PlanesKeepTheirColours) {
  const auto frame =
      JpegEncoder({.quality = 90, .color = true}).encode(yuv420_frame(100, 90, 180), 0);
  ASSERT_TRUE(frame);
  const auto pixels = decode_rgb(frame.value());
  for (std::size_t i = 0; i < pixels.size(); i += 3) {  // ITU-R BT.601, full range
    ASSERT_NEAR(pixels[i], 100 + 1.402 * (180 - 128), 4) << i;
    ASSERT_NEAR(pixels[i + 1], 100 - 0.344 * (90 - 128) - 0.714 * (180 - 128), 4) << i;
    ASSERT_NEAR(pixels[i + 2], 100 + 1.772 * (90 - 128), 4) << i;
  }
}

TEST(JpegEncoder, OfPlanesInGrayTheLumaIsEncoded) {
  const auto frame = JpegEncoder({}).encode(yuv420_frame(100, 90, 180), 0);
  ASSERT_TRUE(frame);
  JpegCodec codec;
  EXPECT_TRUE(codec.inspect(frame.value().jpeg).value().is_gray);
  EXPECT_NEAR(codec.decode_gray(frame.value().jpeg, 1).value().pixels.back(), 100, 2);
}

TEST(JpegEncoder, PlanesThatAreTooShortAreRefused) {
  JpegEncoder encoder({.quality = 80, .color = true});
  RawFrame frame = yuv420_frame(1, 2, 3);
  frame.data = frame.data.first(frame.data.size() - 1);
  EXPECT_THAT(error_of(encoder, frame), HasSubstr("are too few"));
}

constexpr std::size_t kStride = 192;

TEST(JpegEncoder, RowsMayBePadded) {
  const auto raw = scene_frame();
  std::vector<std::uint8_t> padded(kStride * 119 + 160, 255);
  for (std::size_t y = 0; y < 120; ++y) {
    std::copy_n(raw.data.begin() + static_cast<std::ptrdiff_t>(y * 160), 160,
                padded.begin() + static_cast<std::ptrdiff_t>(y * kStride));
  }
  auto raw_padded = raw;
  raw_padded.data = padded;
  raw_padded.stride_bytes = kStride;
  JpegEncoder encoder({});
  EXPECT_EQ(encoder.encode(raw_padded, 0).value().jpeg, encoder.encode(raw, 0).value().jpeg);
}

TEST(JpegEncoder, AHigherQualityCostsMoreBytes) {
  const auto raw = scene_frame();
  EXPECT_LT(JpegEncoder({.quality = 40}).encode(raw, 0).value().jpeg.size(),
            JpegEncoder({.quality = 95}).encode(raw, 0).value().jpeg.size());
}

TEST(JpegEncoder, WhatIsJpegAlreadyIsPassedThroughByteForByte) {
  JpegEncoder encoder({.quality = 10});
  const auto jpeg = JpegEncoder({.quality = 95, .color = true}).encode(scene_frame(true), 0);
  ASSERT_TRUE(jpeg);
  const auto frame = encoder.encode(jpeg_frame(jpeg.value().jpeg), 7);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame.value().jpeg, jpeg.value().jpeg);
  EXPECT_EQ(frame.value().jpeg_crc, jpeg.value().jpeg_crc);
  EXPECT_EQ(frame.value().width_px, 160);
  EXPECT_EQ(frame.value().height_px, 120);
}

TEST(JpegEncoder, ATruncatedJpegFailsAtEveryLength) {
  JpegEncoder encoder({});
  const auto jpeg = encoder.encode(scene_frame(), 0).value().jpeg;
  for (std::size_t size = 0; size + 2 < jpeg.size(); ++size) {
    ASSERT_NE(error_of(encoder, jpeg_frame(std::span(jpeg).first(size))), "") << size;
  }
}

TEST(JpegEncoder, WhatReadersMayNotExpectOfACamerasJpegIsMended) {
  JpegEncoder encoder({});
  const auto good = encoder.encode(scene_frame(true), 0).value().jpeg;
  std::vector<std::vector<std::uint8_t>> faulty(3, good);
  faulty[0].resize(good.size() - 2);
  faulty[1].insert(faulty[1].end(), {'\r', '\n', 0xFF, 0xD9, 0, 0});
  faulty[2] = test::with_zeros_in_head(good, 604);
  for (const auto& jpeg : faulty) {
    const auto frame = encoder.encode(jpeg_frame(jpeg), 0);
    ASSERT_TRUE(frame) << frame.error().text;
    EXPECT_EQ(frame.value().jpeg, good);
    EXPECT_EQ(frame.value().jpeg_crc, wire::crc32(good));
  }
}

TEST(JpegEncoder, SpareBytesWithinAScanAreKept) {
  const auto jpeg = test::restart_jpeg(64, 48, true, 3);
  EXPECT_EQ(JpegEncoder({}).encode(jpeg_frame(jpeg), 0).value().jpeg, jpeg);
}

TEST(JpegEncoder, ADefectIsTheReasonOfTheFailure) {
  JpegEncoder encoder({});
  RawFrame raw;
  raw.defect = "cannot read 000001.png: it is empty";
  EXPECT_EQ(error_of(encoder, raw), raw.defect);
}

TEST(JpegEncoder, SizesThatNoFrameCanHaveFail) {
  JpegEncoder encoder({});
  const std::vector<std::uint8_t> pixels(65536);
  RawFrame raw;
  raw.data = pixels;
  raw.width_px = 65536;
  raw.height_px = 1;
  raw.stride_bytes = 65536;
  EXPECT_THAT(error_of(encoder, raw), HasSubstr("65536x1"));
  raw.width_px = 0;
  EXPECT_THAT(error_of(encoder, raw), HasSubstr("0x1"));
}

TEST(JpegEncoder, PixelsThatAreNotThereFail) {
  JpegEncoder encoder({});
  auto raw = scene_frame();
  raw.data = raw.data.first(raw.data.size() - 1);
  EXPECT_THAT(error_of(encoder, raw), HasSubstr("too few"));
  raw = scene_frame();
  raw.stride_bytes = 159;
  EXPECT_THAT(error_of(encoder, raw), HasSubstr("too few"));
  raw.data = {};
  EXPECT_THAT(error_of(encoder, raw), HasSubstr("too few"));
}

TEST(JpegEncoder, BothImagesOfAStereoFrameAreEncodedAsEachAlone) {
  JpegEncoder encoder({});
  auto raw = scene_frame();
  const auto left = encoder.encode(raw, 0).value();
  const auto right_raw = scene_frame(true);
  const auto right = encoder.encode(right_raw, 0).value();
  EXPECT_FALSE(left.is_stereo());
  raw.right = std::make_shared<const RawFrame>(right_raw);
  const auto frame = encoder.encode(raw, 3);
  ASSERT_TRUE(frame);
  EXPECT_TRUE(frame.value().is_stereo());
  EXPECT_THAT(frame.value().left(), testing::ElementsAreArray(left.jpeg));
  EXPECT_THAT(frame.value().right(), testing::ElementsAreArray(right.jpeg));
  EXPECT_EQ(frame.value().jpeg_crc, wire::crc32(frame.value().jpeg));
  EXPECT_EQ(frame.value().capture_time_ns, raw.capture_time_ns);
  EXPECT_EQ(frame.value().width_px, 160);
}

TEST(JpegEncoder, AStereoFrameWithADefectInEitherImageFails) {
  JpegEncoder encoder({});
  RawFrame broken;
  broken.defect = "it is empty";
  auto raw = scene_frame();
  raw.right = std::make_shared<const RawFrame>(broken);
  EXPECT_EQ(error_of(encoder, raw), "right image: it is empty");
  broken.right = std::make_shared<const RawFrame>(scene_frame());
  EXPECT_EQ(error_of(encoder, broken), "it is empty");
}

TEST(JpegEncoder, ImagesOfOneFrameHaveOneSize) {
  JpegEncoder encoder({});
  auto raw = scene_frame();
  auto lower = raw;
  --lower.height_px;
  raw.right = std::make_shared<const RawFrame>(lower);
  EXPECT_EQ(error_of(encoder, raw), "left image of 160x120 px, right one of 160x119 px");
}

TEST(JpegEncoder, AJpegWithoutHuffmanTablesIsSentWithThem) {
  auto jpeg = JpegEncoder({}).encode(scene_frame(), 0).value().jpeg;
  const auto whole = jpeg;
  for (auto at = jpeg.begin() + 2; at[1] != 0xDA;) {
    const auto end = at + 2 + at[2] * 256 + at[3];
    at = at[1] == 0xC4 ? jpeg.erase(at, end) : end;
  }
  const auto frame = JpegEncoder({}).encode(jpeg_frame(jpeg), 0);
  ASSERT_TRUE(frame);
  EXPECT_GE(frame.value().jpeg.size(), whole.size());
  EXPECT_EQ(frame.value().jpeg_crc, wire::crc32(frame.value().jpeg));
}

}  // namespace
}  // namespace orbbuf
