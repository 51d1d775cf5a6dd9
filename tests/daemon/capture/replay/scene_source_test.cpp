// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/replay/scene_source.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

#include "common/wire.hpp"
#include "tests/daemon/capture/source_test_support.hpp"

namespace orbbuf {
namespace {

using test::error_of;
using testing::HasSubstr;

SourceSettings small_scene() {
  SourceSettings settings;
  settings.width_px = 96;
  settings.height_px = 64;
  settings.frames = 30;
  return settings;
}

std::vector<std::vector<std::uint8_t>> pixels_of(const SourceSettings& settings) {
  SceneSource source(settings);
  std::vector<std::vector<std::uint8_t>> frames;
  while (const auto frame = source.next({}))
    frames.emplace_back(frame->data.begin(), frame->data.end());
  return frames;
}

std::string error(int width_px, int height_px, std::int64_t frames) {
  SourceSettings settings;
  settings.width_px = width_px;
  settings.height_px = height_px;
  settings.frames = frames;
  return error_of([&] { SceneSource source(settings); });
}

TEST(SceneSource, OneSeedGivesTheSameBytesAndAnotherSeedOthers) {
  auto settings = small_scene();
  const auto once = pixels_of(settings);
  EXPECT_EQ(once, pixels_of(settings));
  settings.seed = 2;
  const auto other = pixels_of(settings);
  for (std::size_t i = 0; i < once.size(); ++i) EXPECT_NE(once[i], other[i]) << i;
}

TEST(SceneSource, ItsWorldIsTheSameOnEveryMachine) {
  EXPECT_EQ(wire::crc32(make_scene_canvas(1, 512, 1).pixels), 3280359850U);
  EXPECT_EQ(wire::crc32(make_scene_canvas(1, 512, 3).pixels), 54915127U);
}

TEST(SceneSource, GivesAsManyFramesAsAskedForAtTheRateAskedFor) {
  auto settings = small_scene();
  settings.fps = 30;
  SceneSource source(settings);
  for (int i = 0; i < 30; ++i) {
    const auto frame = source.next({});
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->capture_time_ns, std::llround(i * 1e9 / 30));
    EXPECT_EQ(frame->format, PixelFormat::kGray8);
    EXPECT_EQ(frame->width_px, 96);
    EXPECT_EQ(frame->height_px, 64);
  }
  EXPECT_FALSE(source.next({}));
}

TEST(SceneSource, IsInColourOnlyWhereAskedFor) {
  auto settings = small_scene();
  settings.color = true;
  SceneSource source(settings);
  const auto frame = source.next({});
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->format, PixelFormat::kBgr24);
  EXPECT_EQ(frame->stride_bytes, 3U * 96U);
  EXPECT_EQ(frame->data.size(), 3U * 96U * 64U);
}

TEST(SceneSource, EverySizeAllowedWorksAndShowsContrast) {
  for (const auto& [width, height] : {std::pair(64, 64), {4096, 64}, {64, 4096}, {4096, 4096}}) {
    SourceSettings settings;
    settings.width_px = width;
    settings.height_px = height;
    SceneSource source(settings);
    const auto frame = source.next({});
    ASSERT_TRUE(frame);
    ASSERT_EQ(frame->data.size(),
              static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
    const auto [darkest, brightest] = std::minmax_element(frame->data.begin(), frame->data.end());
    EXPECT_GT(*brightest - *darkest, 64);
  }
}

TEST(SceneSource, WhatCannotBeGeneratedStopsTheStart) {
  EXPECT_THAT(error(63, 480, 1), HasSubstr("cannot generate 1 frames of 63x480 px"));
  EXPECT_THAT(error(640, 4097, 1), HasSubstr("64 to 4096 px"));
  EXPECT_THAT(error(640, 480, 0), HasSubstr("at least 1"));
  EXPECT_EQ(error(64, 64, 1), "");
}

TEST(SceneSource, AStopEndsIt) {
  SceneSource source(small_scene());
  std::stop_source stop;
  stop.request_stop();
  EXPECT_FALSE(source.next(stop.get_token()));
}

}  // namespace
}  // namespace orbbuf
