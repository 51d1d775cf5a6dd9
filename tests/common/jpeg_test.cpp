// SPDX-License-Identifier: Apache-2.0
#include "common/jpeg.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include "testing/captured_log.hpp"
#include "testing/restart_jpeg.hpp"

namespace orbbuf {
namespace {

using test::restart_jpeg;
using test::with_zeros_in_head;
using testing::HasSubstr;
using Bytes = std::vector<std::uint8_t>;

/// Soft waves, as a camera's picture is soft: JPEG keeps them within a few gray levels.
class Jpeg : public testing::Test {
 protected:
  static std::uint8_t luma(int x, int y) {
    return static_cast<std::uint8_t>(128 + 60 * std::sin(x * 0.05) + 60 * std::cos(y * 0.04));
  }
  /// Rows are `padding` bytes longer than their pixels.
  std::vector<std::uint8_t> encode(int width_px, int height_px, int channels, bool color,
                                   std::size_t padding = 0, int quality = 90) {
    const std::size_t stride = static_cast<std::size_t>(width_px * channels) + padding;
    std::vector<std::uint8_t> pixels(stride * static_cast<std::size_t>(height_px), 0xEE);
    for (int y = 0; y < height_px; ++y) {
      std::uint8_t* at = &pixels[static_cast<std::size_t>(y) * stride];
      for (int x = 0; x < width_px * channels; ++x) *at++ = luma(x / channels, y);
    }
    return codec_.encode({pixels.data(), width_px, height_px, stride, channels}, quality, color)
        .value();
  }
  static double mean_error(const GrayImage& image, int scale) {
    double sum = 0;
    for (int y = 0; y < image.height_px; ++y) {
      for (int x = 0; x < image.width_px; ++x) {
        const std::size_t i =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(image.width_px) +
            static_cast<std::size_t>(x);
        sum += std::abs(image.pixels[i] - luma(x * scale + scale / 2, y * scale + scale / 2));
      }
    }
    return sum / static_cast<double>(image.pixels.size());
  }

  JpegCodec codec_;
};

TEST_F(Jpeg, GrayImageSurvivesThereAndBack) {
  const auto image = codec_.decode_gray(encode(161, 121, 1, false), 1).value();
  EXPECT_EQ(image.width_px, 161);
  EXPECT_EQ(image.height_px, 121);
  EXPECT_EQ(image.pixels.size(), 161U * 121U);
  EXPECT_LT(mean_error(image, 1), 1.5);
}

TEST_F(Jpeg, RowsMayBePadded) {
  EXPECT_EQ(encode(161, 121, 1, false, 13), encode(161, 121, 1, false));
  EXPECT_EQ(encode(161, 121, 3, true, 13), encode(161, 121, 3, true));
}

TEST_F(Jpeg, ScaledImageIsRoundedUpAndAlike) {
  const auto jpeg = encode(161, 121, 1, false);
  for (const int scale : {2, 4, 8}) {
    const auto image = codec_.decode_gray(jpeg, scale).value();
    EXPECT_EQ(image.width_px, (161 + scale - 1) / scale);
    EXPECT_EQ(image.height_px, (121 + scale - 1) / scale);
    EXPECT_LT(mean_error(image, scale), 4) << scale;
  }
}

TEST_F(Jpeg, SmallestImageCanBeScaled) {
  const auto image = codec_.decode_gray(encode(1, 1, 1, false), 8).value();
  EXPECT_EQ(image.width_px, 1);
  EXPECT_EQ(image.height_px, 1);
}

TEST_F(Jpeg, ColorImageIsEncodedInColorOrGrayAsWished) {
  EXPECT_FALSE(codec_.inspect(encode(64, 48, 3, true)).value().is_gray);
  EXPECT_TRUE(codec_.inspect(encode(64, 48, 3, false)).value().is_gray);
  EXPECT_TRUE(codec_.inspect(encode(64, 48, 1, true)).value().is_gray);
}

TEST_F(Jpeg, ColorImageDecodesToItsLuma) {
  const auto image = codec_.decode_gray(encode(161, 121, 3, true), 1).value();
  EXPECT_LT(mean_error(image, 1), 1.5);
}

TEST_F(Jpeg, BlueIsTheFirstChannel) {
  const std::vector<std::uint8_t> blue = {255, 0, 0};
  const auto jpeg = codec_.encode({blue.data(), 1, 1, 3, 3}, 100, true).value();
  EXPECT_NEAR(codec_.decode_gray(jpeg, 1).value().pixels[0], 29, 3);  // 0.114 of 255
}

TEST_F(Jpeg, LowerQualityIsSmaller) {
  EXPECT_LT(encode(320, 240, 1, false, 0, 40).size(), encode(320, 240, 1, false, 0, 95).size());
}

TEST_F(Jpeg, ImageThatCannotBeEncodedIsAnError) {
  const std::uint8_t pixel = 0;
  EXPECT_THAT(codec_.encode({&pixel, 0, 1, 1, 1}, 80, false).error().text,
              HasSubstr("cannot encode an image of 0x1 pixels: "));
  EXPECT_TRUE(codec_.encode({&pixel, 1, 1, 1, 1}, 80, false));
}

TEST_F(Jpeg, InspectTellsTheSize) {
  const auto info = codec_.inspect(encode(161, 121, 1, false)).value();
  EXPECT_EQ(info.width_px, 161);
  EXPECT_EQ(info.height_px, 121);
}

TEST_F(Jpeg, BytesBehindTheEndMarkerAreNotOfTheImage) {
  const auto whole = encode(64, 48, 1, false);
  for (const auto& behind : std::vector<Bytes>{Bytes(100), {0xFF, 0xFF}, {'\r', '\n'}, whole}) {
    auto jpeg = whole;
    jpeg.insert(jpeg.end(), behind.begin(), behind.end());
    const auto info = codec_.inspect(jpeg).value();
    EXPECT_EQ(info.bytes, whole.size());
    EXPECT_TRUE(info.has_end);
    EXPECT_TRUE(codec_.decode_gray(jpeg, 1));
  }
  EXPECT_EQ(codec_.repaired(), 4U);
  EXPECT_EQ(codec_.inspect(whole).value().bytes, whole.size());
  EXPECT_EQ(codec_.repaired(), 4U);
}

TEST_F(Jpeg, TheEndMarkerOfASegmentIsNotThatOfTheImage) {
  auto jpeg = encode(64, 48, 1, false);
  const std::array<std::uint8_t, 8> comment = {0xFF, 0xFE, 0, 6, 0xFF, 0xD9, 0xFF, 0xD8};
  jpeg.insert(jpeg.begin() + 2, comment.begin(), comment.end());
  jpeg.insert(jpeg.end() - 2, comment.begin(), comment.end());
  EXPECT_EQ(codec_.inspect(jpeg).value().bytes, jpeg.size());
}

TEST_F(Jpeg, WithoutItsEndMarkerItIsReadIfAllRowsAreThere) {
  const auto whole = encode(64, 48, 1, false);
  const auto pixels = codec_.decode_gray(whole, 1).value().pixels;
  for (const std::size_t missing : {1U, 2U}) {
    const auto jpeg = std::span(whole).first(whole.size() - missing);
    EXPECT_EQ(codec_.decode_gray(jpeg, 1).value().pixels, pixels);
    const auto info = codec_.inspect(jpeg).value();
    EXPECT_FALSE(info.has_end);
    EXPECT_EQ(info.bytes, jpeg.size());
  }
  EXPECT_EQ(codec_.repaired(), 4U);
}

TEST_F(Jpeg, TruncatedAtAnyLengthIsAnError) {
  const auto jpeg = encode(64, 48, 1, false);
  for (std::size_t size = 0; size + 2 < jpeg.size(); ++size) {
    const auto cut = std::span(jpeg).first(size);
    EXPECT_FALSE(codec_.inspect(cut)) << size;
    EXPECT_FALSE(codec_.decode_gray(cut, 1)) << size;
  }
  EXPECT_EQ(codec_.repaired(), 0U);
}

TEST_F(Jpeg, ErrorsSayWhatIsMissing) {
  const auto jpeg = encode(64, 48, 1, false);
  EXPECT_EQ(codec_.inspect(std::span(jpeg).first(jpeg.size() - 9)).error().text,
            "cannot read a JPEG: Premature end of JPEG file");
  EXPECT_EQ(codec_.decode_gray(std::span(jpeg).first(jpeg.size() - 9), 1).error().text,
            "cannot decode a JPEG: Premature end of JPEG file");
  EXPECT_EQ(codec_.inspect(std::span(jpeg).first(100)).error().text,
            "cannot read a JPEG: Premature end of JPEG file");
  const std::vector<std::uint8_t> png = {0x89, 'P', 'N', 'G', '\r', '\n', 0x1A, '\n'};
  EXPECT_EQ(codec_.inspect(png).error().text,
            "cannot read a JPEG: Not a JPEG file: starts with 0x89 0x50");
}

TEST_F(Jpeg, SpareBytesBeforeRestartMarkersArePassedOver) {
  for (const bool is_color : {false, true}) {
    const auto whole = codec_.decode_gray(restart_jpeg(64, 48, is_color, 0), 1).value();
    for (const std::size_t spare : {1U, 2U, 3U, 4U}) {
      const auto jpeg = restart_jpeg(64, 48, is_color, spare);
      EXPECT_EQ(codec_.inspect(jpeg).value().bytes, jpeg.size());
      EXPECT_EQ(codec_.decode_gray(jpeg, 1).value().pixels, whole.pixels) << spare;
      const auto halves = codec_.halve(jpeg).value();
      EXPECT_EQ(codec_.decode_gray(halves.right, 1).value().width_px, 32);
    }
  }
  EXPECT_GT(codec_.repaired(), 0U);  // libjpeg does not tell of a few that it has read ahead
}

TEST_F(Jpeg, MoreOfThemAreTheRestOfCorruptData) {
  const auto jpeg = restart_jpeg(64, 48, false, 5);
  EXPECT_THAT(
      codec_.decode_gray(jpeg, 1).error().text,
      HasSubstr("cannot decode a JPEG: Corrupt JPEG data: 10 extraneous bytes before marker"));
  EXPECT_FALSE(codec_.halve(jpeg));
}

TEST_F(Jpeg, AnyBytesBetweenTheSegmentsOfTheHeadArePassedOver) {
  const auto whole = encode(64, 48, 1, false);
  const auto jpeg = with_zeros_in_head(whole, 600);
  EXPECT_EQ(codec_.inspect(jpeg).value().bytes, jpeg.size());
  EXPECT_EQ(codec_.decode_gray(jpeg, 1).value().pixels,
            codec_.decode_gray(whole, 1).value().pixels);
  EXPECT_EQ(codec_.repaired(), 2U);
}

TEST_F(Jpeg, AVersionOfJfifThatIsNotKnownIsPassed) {
  auto jpeg = encode(64, 48, 1, false);
  ASSERT_EQ(jpeg[11], 1);  // major version
  jpeg[11] = 2;
  EXPECT_TRUE(codec_.inspect(jpeg));
  EXPECT_TRUE(codec_.decode_gray(jpeg, 1));
  EXPECT_EQ(codec_.repaired(), 2U);
}

TEST_F(Jpeg, TheFirstRepairIsLoggedAndInTheEndHowManyThereWere) {
  const auto jpeg = with_zeros_in_head(encode(16, 16, 1, false), 600);
  const test::CapturedLog log;
  {
    JpegCodec codec("camera 1");
    for (int i = 0; i < 3; ++i) EXPECT_TRUE(codec.decode_gray(jpeg, 1));
  }
  EXPECT_THAT(log.lines(),
              testing::ElementsAre(
                  "warning camera 1: repaired a JPEG: Corrupt JPEG data: 600 extraneous bytes "
                  "before marker 0xdb (further ones are counted, and not logged)",
                  "info camera 1: repaired 3 JPEGs"));
}

TEST_F(Jpeg, CorruptDataIsAnError) {
  auto jpeg = encode(320, 240, 1, false);
  jpeg[jpeg.size() / 2] = 0xFF;  // no marker has this place
  jpeg[jpeg.size() / 2 + 1] = 0xD3;
  EXPECT_TRUE(codec_.inspect(jpeg));
  EXPECT_FALSE(codec_.decode_gray(jpeg, 1));
}

TEST_F(Jpeg, HugeSizeIsRefusedBeforeMemoryIsTakenForIt) {
  auto jpeg = encode(64, 48, 1, false);
  for (std::size_t i = 0; i + 8 < jpeg.size(); ++i) {
    if (jpeg[i] != 0xFF || jpeg[i + 1] != 0xC0) continue;  // start of frame
    jpeg[i + 5] = jpeg[i + 7] = 0x80;                      // the high bytes of height and width
    jpeg[i + 6] = jpeg[i + 8] = 0;
    break;
  }
  EXPECT_EQ(codec_.decode_gray(jpeg, 1).error().text,
            "cannot decode a JPEG: 32768x32768 pixels are over the limit of 67108864 pixels");
}

TEST_F(Jpeg, CodecWorksOnAfterAnError) {
  EXPECT_FALSE(codec_.decode_gray({}, 1));
  EXPECT_TRUE(codec_.decode_gray(encode(64, 48, 1, false), 1));
}

TEST_F(Jpeg, HalvesHoldThePixelsOfTheWhole) {
  for (const bool is_color : {false, true}) {
    const auto jpeg = encode(128, 50, is_color ? 3 : 1, is_color);
    const auto whole = codec_.decode_gray(jpeg, 1).value();
    const auto halves = codec_.halve(jpeg).value();
    const auto left = codec_.decode_gray(halves.left, 1).value();
    const auto right = codec_.decode_gray(halves.right, 1).value();
    ASSERT_EQ(left.width_px, 64);
    ASSERT_EQ(right.width_px, 64);
    ASSERT_EQ(right.height_px, 50);
    auto row = whole.pixels.begin();
    for (std::ptrdiff_t at = 0; at < 50 * 64; at += 64, row += 128) {
      ASSERT_TRUE(std::equal(row, row + 64, left.pixels.begin() + at)) << at / 64;
      ASSERT_TRUE(std::equal(row + 64, row + 128, right.pixels.begin() + at)) << at / 64;
    }
    EXPECT_EQ(codec_.inspect(halves.left).value().is_gray, !is_color);
  }
}

TEST_F(Jpeg, HalvesAreWholeBlocksWide) {
  EXPECT_TRUE(codec_.halve(encode(48, 16, 1, false)));
  EXPECT_EQ(codec_.halve(encode(48, 16, 3, true)).error().text,
            "cannot split a JPEG: it has 48x16 px, and each half must be a multiple of 16 px wide");
  EXPECT_FALSE(codec_.halve(encode(49, 16, 1, false)));
}

TEST_F(Jpeg, ATruncatedJpegIsNotHalved) {
  const auto jpeg = encode(64, 48, 1, false);
  for (std::size_t size = 0; size + 2 < jpeg.size(); ++size) {
    EXPECT_FALSE(codec_.halve(std::span(jpeg).first(size))) << size;
  }
}

/// Breaks each byte of a JPEG's head in turn, and uses the same codec for a good image after each.
TEST_F(Jpeg, ABrokenImageDoesNotAffectTheNextOne) {
  const auto good = encode(64, 48, 1, false);
  const auto head = std::min<std::size_t>(good.size() - 2, 640);
  for (std::size_t at = 0; at < head; ++at) {
    auto broken = good;
    broken[at] ^= 0xFF;
    const bool is_fine = codec_.inspect(broken).has_value() && codec_.decode_gray(broken, 1);
    broken.resize(at);
    const bool is_cut_fine = codec_.inspect(broken).has_value();
    ASSERT_FALSE(is_cut_fine) << at << is_fine;
    const auto info = codec_.inspect(good);
    ASSERT_TRUE(info) << at;
    ASSERT_EQ(info.value().width_px, 64) << at;
    ASSERT_TRUE(codec_.decode_gray(good, 1)) << at;
  }
}

}  // namespace
}  // namespace orbbuf
