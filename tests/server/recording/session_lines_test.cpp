// SPDX-License-Identifier: Apache-2.0
#include "server/recording/session_lines.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <string>

namespace orbbuf {
namespace {

using session_lines::Checksum;
using session_lines::Late;
using session_lines::parse_checksum;
using session_lines::parse_late;
using session_lines::parse_quality;
using session_lines::parse_times;
using session_lines::Quality;
using session_lines::Times;

TEST(SessionLines, TimesAreReadBackAsTheyWereWritten) {
  constexpr auto kLast = std::numeric_limits<std::int64_t>::max();
  for (const Times& times : {Times{123, 1'633'012'000, "0.000000"}, Times{0, -1, "16.666000"},
                             Times{std::numeric_limits<Sequence>::max(), kLast, "4294.967295"}}) {
    EXPECT_EQ(parse_times(to_text(times)), times) << to_text(times);
  }
  EXPECT_EQ(to_text(Times{123, 1'633'012'000, "0.000000"}), "123 1.633012000 0.000000");
}

TEST(SessionLines, WhatIsNoLineOfTimesIsNone) {
  for (const char* line :
       {"", "1", "1 2.000000000", "x 2.000000000 0", "1x 2.000000000 0", " 2.000000000 0",
        "1 2.0 0", "1 2.000000000 3 4", "-1 2.000000000 0", "18446744073709551616 2.000000000 0"}) {
    EXPECT_EQ(parse_times(line), std::nullopt) << line;
  }
}

TEST(SessionLines, LateFramesAreReadBackAsTheyWereWritten) {
  const Late mono{123, 1'633'012'000, "8.500000", 0xA1B, std::nullopt, 1'763'779'406'123'456'789,
                  80};
  const Late pair{std::numeric_limits<Sequence>::max(), -1, "0.000000", 0, 0xFFFFFFFF, 0};
  EXPECT_EQ(to_csv(mono), "123,1.633012000,8.500000,00000A1B,,1763779406.123456789,80");
  for (const Late& late : {mono, pair}) EXPECT_EQ(parse_late(to_csv(late)), late) << to_csv(late);
}

TEST(SessionLines, WhatIsNoLineOfLateFramesIsNone) {
  for (const char* line :
       {"", ",", "1,1.000000000,0,00000A1B,", "1,1.000000000,0,00000A1B,,,0", ",,,,,,",
        "1,1.000000000,0,00000A1B,,1.000000000", "1,1.000000000,0,00000A1B,,1.000000000,",
        "1,1.000000000,0,00000A1B,,1.000000000,0,", "-1,1.000000000,0,00000A1B,,1.000000000,0",
        "1,1.0,0,00000A1B,,1.000000000,0", "1,1.000000000,0,A1B,,1.000000000,0",
        "1,1.000000000,0,,00000A1B,1.000000000,0", "1,1.000000000,0,00000A1B,x,1.000000000,0",
        "1,1.000000000,0,00000A1B,,1.000000000,101", "1,1.000000000,0,00000A1B,,1.000000000,x",
        "sequence,capture_time_s,exposure_ms,crc,crc_right,arrived_s,quality"}) {
    EXPECT_EQ(parse_late(line), std::nullopt) << line;
  }
  EXPECT_NE(parse_late("1,1.000000000,0,00000A1B,,1.000000000,0"), std::nullopt);
}

TEST(SessionLines, QualitiesAreReadBackAsTheyWereWritten) {
  EXPECT_EQ(to_csv(Quality{123, 30, 40'123, 0xA1B2C3D}), "123,30,40123,0A1B2C3D");
  EXPECT_EQ(to_csv(Quality{0, 80}), "0,80,0,00000000");
  const Quality largest{std::numeric_limits<Sequence>::max(), 100, 0xFFFFFFFF, 0xFFFFFFFF};
  for (const Quality& quality : {Quality{}, Quality{7, 0, 1, 0}, largest}) {
    EXPECT_EQ(parse_quality(to_csv(quality)), quality) << to_csv(quality);
  }
}

TEST(SessionLines, WhatIsNoLineOfQualitiesIsNone) {
  for (const char* line :
       {"", ",", ",,,", "1,30,0", "1,30,0,", "1,30,0,00000000,", "1,101,0,00000000",
        "1,-1,0,00000000", "1,,0,00000000", "x,30,0,00000000", "1,30,4294967296,00000000",
        "1,30,0,A1B", "sequence,quality,whole_bytes,whole_crc"}) {
    EXPECT_EQ(parse_quality(line), std::nullopt) << line;
  }
}

TEST(SessionLines, AFrameIsListedIfSomethingIsKnown) {
  EXPECT_FALSE(Quality{7}.is_known());
  EXPECT_TRUE((Quality{7, 1}.is_known()));
  EXPECT_TRUE((Quality{7, 0, 1}.is_known()));
}

TEST(SessionLines, ExposureIsInMilliseconds) {
  EXPECT_EQ(session_lines::exposure_ms(0), "0.000000");
  EXPECT_EQ(session_lines::exposure_ms(8'500'001), "8.500001");
  EXPECT_EQ(session_lines::exposure_ms(4'294'967'295), "4294.967295");
}

TEST(SessionLines, AChecksumIsOfEightDigits) {
  const std::string line = session_lines::checksum("images/000001.jpg", 0xA1B);
  EXPECT_EQ(line, "images/000001.jpg 00000A1B");
  EXPECT_EQ(parse_checksum(line), (Checksum{"images/000001.jpg", 0xA1B}));
}

TEST(SessionLines, WhatIsNoLineOfChecksumsIsNone) {
  for (const char* line : {"", "00000A1B", "a.jpg A1B", "a.jpg 00000A1B1", "a.jpg 0000 A1B",
                           "a.jpg 0000-A1B", "a.jpg 00000A1G", "a.jpg 00000A1B "}) {
    EXPECT_EQ(parse_checksum(line), std::nullopt) << line;
  }
}

}  // namespace
}  // namespace orbbuf
