// SPDX-License-Identifier: Apache-2.0
#include "daemon/capture/stereo/side_by_side_source.hpp"

#include <gmock/gmock.h>

#include <memory>
#include <utility>
#include <vector>

#include "daemon/capture/make_source.hpp"
#include "testing/restart_jpeg.hpp"
#include "testing/scripted_source.hpp"

namespace orbbuf {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

RawFrame split(RawFrame frame) {
  auto whole = std::make_unique<test::ScriptedSource>();
  whole->add(std::move(frame));
  whole->end();
  SideBySideSource source(std::move(whole));
  return *source.next({});
}

/// 4x2 pixels of 1, 2, 3, ..., in rows of two bytes more.
RawFrame pixels(PixelFormat format) {
  const std::size_t row = format == PixelFormat::kBgr24 ? 12 : 4;
  auto bytes = std::make_shared<std::vector<std::uint8_t>>(2 * (row + 2));
  for (std::size_t i = 0; i < 2 * row; ++i) {
    (*bytes)[i / row * (row + 2) + i % row] = static_cast<std::uint8_t>(i + 1);
  }
  RawFrame frame;
  frame.capture_time_ns = 7;
  frame.exposure_ns = 8;
  frame.width_px = 4;
  frame.height_px = 2;
  frame.stride_bytes = row + 2;
  frame.format = format;
  frame.data = *bytes;
  frame.lease = std::move(bytes);
  return frame;
}

std::vector<int> row(const RawFrame& frame, std::size_t y) {
  const std::size_t bytes = frame.format == PixelFormat::kBgr24 ? 6 : 2;
  const auto span = frame.data.subspan(y * frame.stride_bytes, bytes);
  return {span.begin(), span.end()};
}

TEST(SideBySideSource, HalvesLieInTheMemoryOfTheWhole) {
  const RawFrame whole = pixels(PixelFormat::kGray8);
  const RawFrame left = split(whole);
  ASSERT_TRUE(left.right);
  const RawFrame& right = *left.right;
  EXPECT_EQ(left.capture_time_ns, 7);
  EXPECT_EQ(left.exposure_ns, 8U);
  EXPECT_EQ(left.width_px, 2);
  EXPECT_EQ(right.width_px, 2);
  EXPECT_EQ(right.height_px, 2);
  EXPECT_EQ(left.data.data(), whole.data.data());
  EXPECT_EQ(right.lease, whole.lease);
  EXPECT_THAT(row(left, 0), ElementsAre(1, 2));
  EXPECT_THAT(row(right, 0), ElementsAre(3, 4));
  EXPECT_THAT(row(left, 1), ElementsAre(5, 6));
  EXPECT_THAT(row(right, 1), ElementsAre(7, 8));
}

TEST(SideBySideSource, ColourHasThreeBytesAPixel) {
  const RawFrame left = split(pixels(PixelFormat::kBgr24));
  EXPECT_THAT(row(left, 0), ElementsAre(1, 2, 3, 4, 5, 6));
  EXPECT_THAT(row(*left.right, 1), ElementsAre(19, 20, 21, 22, 23, 24));
}

TEST(SideBySideSource, PlanesAreSplitEach) {
  RawFrame frame;
  frame.width_px = 4;
  frame.height_px = 2;
  frame.stride_bytes = 4;
  frame.format = PixelFormat::kYuv420;
  const std::vector<std::uint8_t> planes = {1, 2, 3, 4, 5, 6, 7, 8, 50, 51, 60, 61};
  frame.data = planes;
  const RawFrame left = split(frame);
  ASSERT_TRUE(left.right);
  EXPECT_EQ(left.width_px, 2);
  EXPECT_EQ(left.right->width_px, 2);
  EXPECT_EQ(left.right->format, PixelFormat::kYuv420);
  EXPECT_THAT(left.data, ElementsAre(1, 2, 5, 6, 50, 60));
  EXPECT_THAT(left.right->data, ElementsAre(3, 4, 7, 8, 51, 61));
}

TEST(SideBySideSource, JpegIsSplitIntoTwo) {
  const std::vector<std::uint8_t> gray(64 * 16, 100);
  JpegCodec codec;
  const auto jpeg = codec.encode({gray.data(), 64, 16, 64, 1}, 80, false).value();
  RawFrame frame;
  frame.capture_time_ns = 7;
  frame.format = PixelFormat::kJpeg;
  frame.data = jpeg;
  const RawFrame left = split(frame);
  ASSERT_TRUE(left.right);
  EXPECT_EQ(left.capture_time_ns, 7);
  EXPECT_EQ(codec.inspect(left.data).value().width_px, 32);
  EXPECT_EQ(codec.inspect(left.right->data).value().width_px, 32);
  frame.data = frame.data.first(jpeg.size() / 2);
  EXPECT_NE(split(frame).defect, "");
}

TEST(SideBySideSource, JpegWithSpareBytesBeforeRestartMarkersIsSplitToo) {
  const auto jpeg = test::restart_jpeg(64, 32, true, 3);
  RawFrame frame;
  frame.format = PixelFormat::kJpeg;
  frame.data = jpeg;
  const RawFrame left = split(frame);
  ASSERT_TRUE(left.right) << left.defect;
  EXPECT_EQ(JpegCodec().inspect(left.right->data).value().width_px, 32);
}

TEST(SideBySideSource, WhatHasNoEqualHalvesIsADefect) {
  RawFrame odd = pixels(PixelFormat::kGray8);
  odd.width_px = 3;
  const RawFrame frame = split(odd);
  EXPECT_EQ(frame.defect, "cannot split an image of 3x2 px: its width is odd or too small");
  EXPECT_EQ(frame.capture_time_ns, 7);
  EXPECT_THAT(frame.data, IsEmpty());
  EXPECT_FALSE(frame.right);
  odd.defect = "torn";
  EXPECT_EQ(split(odd).defect, "torn");
}

TEST(SideBySideSource, AnyKindOfSourceCanBeSideBySide) {
  SourceSettings settings;
  settings.realtime = false;
  settings.is_side_by_side = true;
  const auto source = make_source(settings);
  EXPECT_THAT(source->description(), testing::HasSubstr(", left and right side by side"));
  const auto frame = source->next({});
  ASSERT_TRUE(frame && frame->right);
  EXPECT_EQ(frame->width_px, 320);
}

}  // namespace
}  // namespace orbbuf
