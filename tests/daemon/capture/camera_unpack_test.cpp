// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/camera_unpack.hpp"

#include <gmock/gmock.h>

#include <numeric>
#include <vector>

namespace orbbuf {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;

using Bytes = std::vector<std::uint8_t>;

Bytes counting(std::size_t size) {
  Bytes bytes(size);
  std::iota(bytes.begin(), bytes.end(), std::uint8_t{0});
  return bytes;
}

CameraMode mode(CameraFormat format, std::size_t stride_bytes) {
  return {.format = format, .width_px = 4, .height_px = 2, .stride_bytes = stride_bytes};
}

Bytes pixels_of(const RawFrame& frame) { return {frame.data.begin(), frame.data.end()}; }

TEST(CameraUnpack, OnlyLumaIsTaken) {
  for (const auto format : {CameraFormat::kGrey, CameraFormat::kNv12, CameraFormat::kYuv420}) {
    const auto frame = unpack(mode(format, 4), counting(12));
    EXPECT_EQ(frame.defect, "");
    EXPECT_EQ(frame.format, PixelFormat::kGray8);
    EXPECT_EQ(frame.width_px, 4);
    EXPECT_EQ(frame.height_px, 2);
    EXPECT_EQ(frame.stride_bytes, 4U);
    EXPECT_THAT(pixels_of(frame), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7));
  }
}

TEST(CameraUnpack, LumaIsPickedOutFromBetweenChroma) {
  const auto yuyv = unpack(mode(CameraFormat::kYuyv, 8), counting(16));
  EXPECT_EQ(yuyv.format, PixelFormat::kGray8);
  EXPECT_EQ(yuyv.stride_bytes, 4U);
  EXPECT_THAT(pixels_of(yuyv), ElementsAre(0, 2, 4, 6, 8, 10, 12, 14));
  const auto uyvy = unpack(mode(CameraFormat::kUyvy, 8), counting(16));
  EXPECT_THAT(pixels_of(uyvy), ElementsAre(1, 3, 5, 7, 9, 11, 13, 15));
}

TEST(CameraUnpack, PaddingOfRowsIsLeftOut) {
  EXPECT_THAT(pixels_of(unpack(mode(CameraFormat::kGrey, 6), counting(12))),
              ElementsAre(0, 1, 2, 3, 6, 7, 8, 9));
  EXPECT_THAT(pixels_of(unpack(mode(CameraFormat::kYuyv, 10), counting(20))),
              ElementsAre(0, 2, 4, 6, 10, 12, 14, 16));
}

TEST(CameraUnpack, TheLastRowNeedsNoPadding) {
  EXPECT_EQ(unpack(mode(CameraFormat::kGrey, 6), counting(10)).defect, "");
  EXPECT_THAT(unpack(mode(CameraFormat::kGrey, 6), counting(9)).defect,
              HasSubstr("truncated image: 9 of 10 bytes"));
}

TEST(CameraUnpack, ColourIsBlueGreenRed) {
  const auto bgr = unpack(mode(CameraFormat::kBgr24, 12), counting(24));
  EXPECT_EQ(bgr.format, PixelFormat::kBgr24);
  EXPECT_EQ(bgr.stride_bytes, 12U);
  EXPECT_EQ(pixels_of(bgr), counting(24));
  const auto rgb = unpack(mode(CameraFormat::kRgb24, 12), counting(24));
  EXPECT_EQ(rgb.format, PixelFormat::kBgr24);
  EXPECT_THAT(rgb.data.first(6), ElementsAre(2, 1, 0, 5, 4, 3));
  EXPECT_EQ(rgb.data.back(), 21);
}

CameraMode color_mode(CameraFormat format, std::size_t stride_bytes) {
  CameraMode mode = orbbuf::mode(format, stride_bytes);
  mode.color = true;
  return mode;
}

TEST(CameraUnpack, InColourPlanesAreTakenWithTheirChroma) {
  const auto nv12 = unpack(color_mode(CameraFormat::kNv12, 4), counting(12));
  EXPECT_EQ(nv12.defect, "");
  EXPECT_EQ(nv12.format, PixelFormat::kYuv420);
  EXPECT_EQ(nv12.stride_bytes, 4U);
  EXPECT_THAT(pixels_of(nv12), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 10, 9, 11));
  const auto yuv420 = unpack(color_mode(CameraFormat::kYuv420, 4), counting(12));
  EXPECT_EQ(pixels_of(yuv420), counting(12));
}

TEST(CameraUnpack, InColourTheChromaOfTwoRowsBecomesItsMean) {
  const auto yuyv = unpack(color_mode(CameraFormat::kYuyv, 8), counting(16));
  EXPECT_EQ(yuyv.format, PixelFormat::kYuv420);
  EXPECT_THAT(pixels_of(yuyv), ElementsAre(0, 2, 4, 6, 8, 10, 12, 14, 5, 9, 7, 11));
  const auto uyvy = unpack(color_mode(CameraFormat::kUyvy, 8), counting(16));
  EXPECT_THAT(pixels_of(uyvy), ElementsAre(1, 3, 5, 7, 9, 11, 13, 15, 4, 8, 6, 10));
}

TEST(CameraUnpack, InColourPaddingIsLeftOutAndPlanesMayLieApart) {
  const auto nv12 = unpack(color_mode(CameraFormat::kNv12, 6), counting(18));
  EXPECT_THAT(pixels_of(nv12), ElementsAre(0, 1, 2, 3, 6, 7, 8, 9, 12, 14, 13, 15));
  const Bytes blue = {90, 91, 0};
  const Bytes red = {92, 93, 0};
  const auto apart = unpack(color_mode(CameraFormat::kYuv420, 6), counting(12), {blue, red});
  EXPECT_THAT(pixels_of(apart), ElementsAre(0, 1, 2, 3, 6, 7, 8, 9, 90, 91, 92, 93));
}

TEST(CameraUnpack, InColourPaddedPlanesMayFollowTheLumaInOneBuffer) {
  const auto yuv420 = unpack(color_mode(CameraFormat::kYuv420, 6), counting(18));
  EXPECT_THAT(pixels_of(yuv420), ElementsAre(0, 1, 2, 3, 6, 7, 8, 9, 12, 13, 15, 16));
  EXPECT_EQ(unpack(color_mode(CameraFormat::kYuv420, 6), counting(17)).defect, "");
  EXPECT_NE(unpack(color_mode(CameraFormat::kYuv420, 6), counting(16)).defect, "");
}

TEST(CameraUnpack, InColourTheLastOddColumnAndRowAreRepeated) {
  CameraMode odd = color_mode(CameraFormat::kYuv420, 3);
  odd.width_px = 3;
  odd.height_px = 1;
  EXPECT_THAT(pixels_of(unpack(odd, counting(7))), ElementsAre(0, 1, 2, 2, 0, 1, 2, 2, 3, 4, 5, 6));
}

TEST(CameraUnpack, ColourThatIsNotCompleteIsADefect) {
  for (const auto format : {CameraFormat::kNv12, CameraFormat::kYuv420}) {
    for (const std::size_t size : {8U, 9U, 11U}) {
      const auto frame = unpack(color_mode(format, 4), counting(size));
      EXPECT_THAT(frame.defect, HasSubstr("its chroma is not complete")) << size;
      EXPECT_TRUE(frame.data.empty());
    }
  }
}

TEST(CameraUnpack, AJpegIsTakenAsItIs) {
  const auto frame = unpack(mode(CameraFormat::kMjpg, 0), counting(5));
  EXPECT_EQ(frame.format, PixelFormat::kJpeg);
  EXPECT_EQ(pixels_of(frame), counting(5));
}

TEST(CameraUnpack, TheFrameOutlivesTheBuffer) {
  auto buffer = counting(8);
  const auto frame = unpack(mode(CameraFormat::kGrey, 4), buffer);
  buffer.assign(8, 0);
  EXPECT_EQ(pixels_of(frame), counting(8));
}

TEST(CameraUnpack, AnImageThatIsNotThereIsADefect) {
  for (std::size_t i = 0; i < kCameraFormats.size(); ++i) {
    const auto frame = unpack(mode(static_cast<CameraFormat>(i), 12), {});
    EXPECT_EQ(frame.defect, "the camera's driver returned an empty buffer");
    EXPECT_TRUE(frame.data.empty());
  }
  EXPECT_THAT(unpack(mode(CameraFormat::kYuyv, 8), counting(15)).defect,
              HasSubstr("15 of 16 bytes"));
  EXPECT_THAT(unpack(mode(CameraFormat::kRgb24, 12), counting(23)).defect, HasSubstr("of 24"));
}

}  // namespace
}  // namespace orbbuf
