// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/libcamera/libcamera_formats.hpp"

#include <gmock/gmock.h>
#include <libcamera/formats.h>
#include <libcamera/stream.h>

namespace orbbuf {
namespace {

using libcamera::Size;
using libcamera::SizeRange;
using libcamera::StreamFormats;
using testing::HasSubstr;
namespace formats = libcamera::formats;

/// As the kernel's vimc: any size, but only colours.
const std::vector<CameraOffer> kOnlyColour = {{"BGR3", {{48, 48, 4096, 2160, {}}}}};

std::string asked(const std::vector<CameraOffer>& offers, std::string_view format, int width_px,
                  bool color = false) {
  const auto chosen = choose_to_ask(offers, {format, width_px, 480, 25, color});
  return chosen ? std::string(to_string(chosen.value())) : chosen.error().text;
}

TEST(LibcameraFormats, NamesOfColoursAreThoseOfAWordReadBackwards) {
  EXPECT_EQ(format_of(formats::RGB888), CameraFormat::kBgr24);
  EXPECT_EQ(format_of(formats::BGR888), CameraFormat::kRgb24);
  EXPECT_EQ(format_of(formats::XRGB8888), std::nullopt);
  for (std::size_t i = 0; i < kCameraFormats.size(); ++i) {
    const auto format = static_cast<CameraFormat>(i);
    EXPECT_EQ(format_of(pixel_format_of(format)), format);
  }
}

TEST(LibcameraFormats, ARangeOfSizesIsOneOffer) {
  const StreamFormats range({{formats::NV12, {SizeRange({48, 32}, {1920, 1080})}}});
  EXPECT_EQ(describe(offers_of(range)), "NV12 48x32 to 1920x1080");
}

TEST(LibcameraFormats, AListOfSizesIsGivenInFull) {
  const StreamFormats list({{formats::XRGB8888, {SizeRange({640, 480}), SizeRange({320, 240})}},
                            {formats::YUYV, {SizeRange({640, 480})}}});
  EXPECT_EQ(describe(offers_of(list)), "XRGB8888 320x240, 640x480; YUYV 640x480");
  EXPECT_EQ(describe(offers_of(StreamFormats())), "nothing");
}

TEST(LibcameraFormats, WhatIsNotOfferedIsLeftToThePipelineToAdjust) {
  EXPECT_EQ(asked(kOnlyColour, "auto", 640), "BGR24");
  EXPECT_EQ(asked(kOnlyColour, "auto", 10), "BGR24");
  EXPECT_EQ(asked(kOnlyColour, "GREY", 640), "GREY");
  EXPECT_EQ(asked({}, "NV12", 640), "NV12");
}

TEST(LibcameraFormats, WhatWouldNotServeIsRefused) {
  EXPECT_THAT(asked({{"XRGB8888", {}}}, "auto", 640), HasSubstr("the camera offers XRGB8888"));
  EXPECT_THAT(asked({{"GREY", {}}}, "auto", 640, true), HasSubstr("in colour"));
  EXPECT_THAT(asked(kOnlyColour, "GREY", 640, true), HasSubstr("no GREY at 640x480 in colour"));
}

}  // namespace
}  // namespace orbbuf
