// SPDX-License-Identifier: Apache-2.0
#include "daemon/probe.hpp"

#include <gmock/gmock.h>

#include <stdexcept>

#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

using testing::HasSubstr;

Settings generated(std::int64_t frames) {
  Settings settings;
  settings.source.width_px = 160;
  settings.source.height_px = 120;
  settings.source.frames = frames;
  settings.source.realtime = false;
  return settings;
}

TEST(Probe, ReportsWhatItCaptured) {
  const auto report = probe(generated(5));
  EXPECT_THAT(report, HasSubstr("source: generated scene 1: 5 frames of 160x120 px, 25 fps\n"));
  EXPECT_THAT(report,
              HasSubstr("captured: 5 frames, 0 of them defective, at 25 fps, 160x120 px\n"));
  EXPECT_THAT(report, HasSubstr("\nJPEG: "));
  EXPECT_THAT(report, HasSubstr("\nORB features"));
}

TEST(Probe, WhatItSuggestsIsAConfiguration) {
  const auto report = probe(generated(5));
  const test::TemporaryFolder folder;
  test::write_file(folder / "c.toml", report.substr(report.find("suggested:\n") + 11));
  const Settings suggested = load_settings(folder / "c.toml", {});
  EXPECT_EQ(suggested.source.width_px, 160);
  EXPECT_EQ(suggested.source.fps, 25);
}

TEST(Probe, ASingleImageIsNotEnough) { EXPECT_THROW(probe(generated(1)), std::runtime_error); }

TEST(Probe, FeaturesThatTakeTooLongGetFewerPixels) {
  ProbeResult result{.fps = 20, .width_px = 640, .height_px = 480, .features_ms = 25};
  EXPECT_THAT(suggest({}, result), HasSubstr("pixels = 131072\n"));
  result.features_ms = 50;
  EXPECT_THAT(suggest({}, result), HasSubstr("pixels = 65536\n"));
  result.features_ms = 10'000;
  EXPECT_THAT(suggest({}, result), HasSubstr("pixels = 10000\n"));
}

TEST(Probe, ACameraIsSuggestedByItsName) {
  Settings settings;
  settings.source.kind = "libcamera";
  settings.source.camera = "platform/vimc.0 Sensor B";
  EXPECT_THAT(suggest(settings, {.fps = 20, .width_px = 64, .height_px = 64}),
              HasSubstr("kind = \"libcamera\"\ncamera = \"platform/vimc.0 Sensor B\"\n"));
}

TEST(Probe, TheSuggestionCapturesTheSame) {
  Settings settings;
  settings.source.kind = "libcamera";
  settings.source.camera = "\\_SB_.PCI0 \"left\"\t\x7F";
  settings.source.controls = {{"brightness", -0.25}, {"exposuretime", 10000}};
  settings.source.crop = Crop{320, 180, 480, 270};
  const test::TemporaryFolder folder;
  test::write_file(folder / "c.toml",
                   suggest(settings, {.fps = 20, .width_px = 64, .height_px = 64}));
  const SourceSettings suggested = load_settings(folder / "c.toml", {}).source;
  EXPECT_EQ(suggested.camera, settings.source.camera);
  EXPECT_EQ(suggested.controls, settings.source.controls);
  EXPECT_EQ(suggested.crop, settings.source.crop);
  settings.source.kind = "v4l2";
  settings.source.device = settings.source.device_right = "/dev/v4l/by-id/\\x";
  EXPECT_THAT(suggest(settings, {.fps = 20}), HasSubstr("device = \"/dev/v4l/by-id/\\\\x\"\n"));
  EXPECT_THAT(suggest(settings, {.fps = 20}), HasSubstr("_right = \"/dev/v4l/by-id/\\\\x\"\n"));
  settings.source.kind = "ros2";
  settings.source.topic = "/left/image_raw";
  settings.source.topic_right = "/right/image_raw";
  EXPECT_THAT(suggest(settings, {.fps = 20}),
              HasSubstr("topic = \"/left/image_raw\"\ntopic_right = \"/right/image_raw\"\n"));
}

TEST(Probe, TheMeasuredRateIsSuggested) {
  ProbeResult result{.fps = 29.97, .width_px = 64, .height_px = 64};
  EXPECT_THAT(suggest({}, result), HasSubstr("fps = 29.97\n"));
}

TEST(Probe, WhatIsSuggestedIsStereoAgain) {
  auto settings = generated(5);
  settings.source.is_side_by_side = true;
  const auto report = probe(settings);
  EXPECT_THAT(report, HasSubstr("at 25 fps, 80x120 px\n"));
  EXPECT_THAT(report, HasSubstr("stereo = \"side-by-side\"\nwidth = 160\nheight = 120\n"));
  settings.source.kind = "v4l2";
  settings.source.device_right = "/dev/video2";
  EXPECT_THAT(suggest(settings, {.fps = 25}), HasSubstr("device_right = \"/dev/video2\"\n"));
}

}  // namespace
}  // namespace orbbuf
