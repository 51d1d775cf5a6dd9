// SPDX-License-Identifier: Apache-2.0
#include "server/session/session_lines.hpp"

#include <gtest/gtest.h>

#include <string>

namespace orbbuf::session_lines {
namespace {

RecordedFrame frame(Sequence sequence) {
  RecordedFrame frame;
  frame.sequence = sequence;
  frame.capture_time_ns = 1'633'012'000;
  frame.exposure_ns = 8'500'000;
  frame.crc = 0x0A1B2C3D;
  return frame;
}

TEST(SessionLines, TimesAreReadBackAsTheyWereWritten) {
  const std::string line = times(frame(123));
  EXPECT_EQ(line, "123 1.633012000 8.500000\n");
  const auto parsed = parse_times(std::string_view(line).substr(0, line.size() - 1));
  EXPECT_EQ(parsed, (Times{123, 1'633'012'000, "8.500000"}));
}

TEST(SessionLines, WhatIsNoLineOfTimesIsNone) {
  for (const char* line : {"", "1", "1 2.0", "1 2 3", "x 1.633012000 0", "1 1.6 0",
                           "-1 1.633012000 0", "1 1.633012000", " 1.633012000 0"}) {
    EXPECT_FALSE(parse_times(line)) << line;
  }
}

TEST(SessionLines, NamesBeginSessionTxt) {
  EXPECT_EQ(names({"r", "s", ""}), "robot r\nsession s\n");
}

TEST(SessionLines, ExposureIsInMilliseconds) {
  EXPECT_EQ(exposure_ms(0), "0.000000");
  EXPECT_EQ(exposure_ms(8'500'001), "8.500001");
}

TEST(SessionLines, EachImageHasAChecksumOfEightDigits) {
  EXPECT_EQ(checksums(frame(123)), "images/000123.jpg 0A1B2C3D\n");
  RecordedFrame pair = frame(1'234'567);
  pair.left_bytes = 10;
  pair.crc_right = 1;
  EXPECT_EQ(checksums(pair), "images/1234567.jpg 0A1B2C3D\nimages_right/1234567.jpg 00000001\n");
}

TEST(SessionLines, AQualityIsListedIfSomethingIsKnown) {
  EXPECT_EQ(quality(frame(1)), "");
  RecordedFrame whole = frame(1);
  whole.quality = 80;
  EXPECT_EQ(quality(whole), "1,80,0,00000000\n");
  RecordedFrame reduced = frame(2);
  reduced.quality = 30;
  reduced.whole_bytes = 40'123;
  reduced.whole_crc = 0x0A1B2C3D;
  EXPECT_EQ(quality(reduced), "2,30,40123,0A1B2C3D\n");
}

}  // namespace
}  // namespace orbbuf::session_lines
