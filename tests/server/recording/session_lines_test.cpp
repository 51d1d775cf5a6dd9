// SPDX-License-Identifier: Apache-2.0
#include "server/recording/session_lines.hpp"

#include <gtest/gtest.h>

#include <limits>
#include <string>

namespace orbbuf {
namespace {

using session_lines::Checksum;
using session_lines::parse_checksum;
using session_lines::parse_times;
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
