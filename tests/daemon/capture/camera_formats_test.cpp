// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/camera_formats.hpp"

#include <gmock/gmock.h>

namespace orbbuf {
namespace {

using testing::HasSubstr;

CameraSize exactly(int width_px, int height_px, std::vector<double> rates) {
  return {width_px, height_px, width_px, height_px, std::move(rates)};
}

/// As most USB cameras are: large images come fast only if compressed.
const std::vector<CameraOffer> kWebcam = {
    {"MJPG", {exactly(640, 480, {30, 15}), exactly(1280, 720, {30})}},
    {"YUYV", {exactly(640, 480, {30, 15}), exactly(1280, 720, {10})}},
};

CameraRequest request(int width_px, int height_px, double fps) {
  CameraRequest request;
  request.width_px = width_px;
  request.height_px = height_px;
  request.fps = fps;
  return request;
}

std::string chosen(const std::vector<CameraOffer>& offers, const CameraRequest& request) {
  const auto format = choose_format(offers, request);
  return format ? std::string(to_string(format.value())) : format.error().text;
}

TEST(CameraFormats, UncompressedIsPreferredWhereItReachesTheRate) {
  EXPECT_EQ(chosen(kWebcam, request(640, 480, 30)), "YUYV");
  EXPECT_EQ(chosen(kWebcam, request(1280, 720, 10)), "YUYV");
  EXPECT_EQ(chosen(kWebcam, request(1280, 720, 10.05)), "YUYV");
  EXPECT_EQ(chosen(kWebcam, request(1280, 720, 11)), "MJPG");
}

TEST(CameraFormats, WhereNoneReachesTheRateTheFastestIsTaken) {
  EXPECT_EQ(chosen(kWebcam, request(1280, 720, 60)), "MJPG");
  EXPECT_EQ(chosen(kWebcam, request(640, 480, 60)), "YUYV");
}

TEST(CameraFormats, LumaInOnePieceIsPreferredToLumaInPieces) {
  std::vector<CameraOffer> offers;
  for (const char* fourcc : {"MJPG", "RGB3", "BGR3", "UYVY", "YUYV", "YU12", "NV12", "GREY"}) {
    offers.push_back({fourcc, {exactly(640, 480, {25})}});
  }
  for (const auto format : kCameraFormats) {
    EXPECT_EQ(chosen(offers, request(640, 480, 25)), format);
    offers.pop_back();
  }
}

TEST(CameraFormats, ColourComesFromAnyFormatButGrey) {
  auto in_color = request(640, 480, 30);
  in_color.color = true;
  EXPECT_EQ(chosen(kWebcam, in_color), "YUYV");
  const std::vector<CameraOffer> gray_too = {{"GREY", {}}, {"NV12", {}}};
  EXPECT_EQ(chosen(gray_too, in_color), "NV12");
  in_color.format = "GREY";
  EXPECT_EQ(chosen(gray_too, in_color),
            "no GREY at 640x480 in colour (any but GREY); the camera offers GREY ; NV12 ");
}

TEST(CameraFormats, AFormatThatIsNamedIsTakenAtAnyRate) {
  auto named = request(1280, 720, 30);
  named.format = "YUYV";
  EXPECT_EQ(chosen(kWebcam, named), "YUYV");
  named.format = "NV12";
  EXPECT_THAT(chosen(kWebcam, named),
              HasSubstr("no NV12 at 1280x720; the camera offers MJPG 640x480"));
}

TEST(CameraFormats, ASizeThatIsNotOfferedFails) {
  EXPECT_THAT(
      chosen(kWebcam, request(800, 600, 30)),
      HasSubstr("no supported format at 800x600; the camera offers MJPG 640x480 (30, 15 fps), "));
  EXPECT_THAT(chosen({}, request(640, 480, 30)), HasSubstr("the camera offers nothing"));
  const std::vector<CameraOffer> raw_bayer = {{"RGGB", {exactly(640, 480, {})}}};
  EXPECT_THAT(chosen(raw_bayer, request(640, 480, 30)),
              HasSubstr("the camera offers RGGB 640x480"));
  const std::vector<CameraOffer> both = {raw_bayer[0], {"GREY", {exactly(320, 240, {})}}};
  EXPECT_EQ(chosen(both, request(640, 480, 30)),
            "no supported format at 640x480; the camera offers GREY 320x240");
}

TEST(CameraFormats, WhatADriverDoesNotSayIsNotHeldAgainstIt) {
  EXPECT_EQ(chosen({{"YUYV", {}}}, request(800, 600, 100)), "YUYV");
  EXPECT_EQ(chosen({{"YUYV", {exactly(640, 480, {})}}}, request(640, 480, 100)), "YUYV");
}

TEST(CameraFormats, ASizeMayBeARange) {
  const std::vector<CameraOffer> sensor = {{"GREY", {{16, 16, 1280, 800, {60}}}}};
  EXPECT_EQ(chosen(sensor, request(16, 16, 30)), "GREY");
  EXPECT_EQ(chosen(sensor, request(1280, 800, 30)), "GREY");
  EXPECT_THAT(chosen(sensor, request(1281, 800, 30)), HasSubstr("GREY 16x16 to 1280x800 (60 fps)"));
}

TEST(CameraFormats, ALongListOfRatesIsCutShort) {
  const std::vector<CameraOffer> offers = {{"GREY", {exactly(64, 48, {60, 50, 30, 29.97, 15})}}};
  EXPECT_EQ(describe(offers), "GREY 64x48 (60, 50, 30, 29.97, ... fps)");
}

}  // namespace
}  // namespace orbbuf
