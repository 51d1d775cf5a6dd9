// SPDX-License-Identifier: Apache-2.0
#include "daemon/probe.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <vector>

#include "common/jpeg.hpp"
#include "common/sample.hpp"
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

/// A camera that is turned to and fro by hand, and a sensor whose clock is 30 ms ahead.
TEST(Probe, TheMotionOfTheImagesTellsTheTimeOfTheSensor) {
  const test::TemporaryFolder folder;
  // A wall of tiles of 8 by 8 pixels, each gray in its own way.
  const auto wall = [](std::size_t x, std::size_t y) {
    return static_cast<std::uint8_t>(40 + (x / 8 * 7919 + y / 8 * 104'729) % 177);
  };
  const auto angle = [](double time_s) {
    return 40 * std::sin(5 * time_s) + 12 * std::sin(11 * time_s);
  };
  std::filesystem::create_directory(folder / "images");
  JpegCodec codec;
  std::string times;
  for (int i = 0; i < 150; ++i) {
    const auto x = static_cast<std::size_t>(std::lround(100 + angle(0.04 * i)));
    std::vector<std::uint8_t> view;
    for (std::size_t pixel = 0; pixel < std::size_t{160} * 120; ++pixel) {
      view.push_back(wall(x + pixel % 160, pixel / 160));
    }
    const auto jpeg = codec.encode({view.data(), 160, 120, 160, 1}, 90, false);
    ASSERT_TRUE(jpeg);
    test::write_file(folder / "images" / fmt::format("{:06}.jpg", i),
                     std::string(jpeg.value().begin(), jpeg.value().end()));
    times += fmt::format("{} {:.3f}\n", i, 100 + 0.04 * i);
  }
  test::write_file(folder / "times.txt", times);
  std::string samples;
  for (int i = -100; i < 1400; ++i) {
    const double time_s = 0.005 * i;
    const double speed = (angle(time_s + 1e-4) - angle(time_s - 1e-4)) / 2e-4 / 200;
    samples += to_euroc_line({std::llround((100.03 + time_s) * 1e9), {0, speed, 0}, {}});
  }
  test::write_file(folder / "imu.csv", samples);
  Settings settings;
  settings.source.kind = "folder";
  settings.source.path = folder / "images";
  settings.source.realtime = false;
  settings.streams.push_back({"imu0", "euroc", folder / "imu.csv"});
  const auto report = probe(settings);
  EXPECT_THAT(report, HasSubstr("\nimu0: 1500 samples, 200.0/s; "));
  const auto at = report.find("its time is the camera's ");
  ASSERT_NE(at, std::string::npos) << report;
  EXPECT_NEAR(std::stod(report.substr(at + 25)), 0.03, 0.011) << report;
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
