// SPDX-License-Identifier: Apache-2.0
#include "common/decimal.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace orbbuf {
namespace {

TEST(Decimal, DigitsAreDigitsOnly) {
  EXPECT_EQ(parse_digits("0"), 0U);
  EXPECT_EQ(parse_digits("18446744073709551615"), std::numeric_limits<std::uint64_t>::max());
  for (const char* text : {"", "-1", "+1", " 1", "1 ", "1.0", "0x1", "18446744073709551616"}) {
    EXPECT_FALSE(parse_digits(text)) << text;
  }
}

TEST(Decimal, SecondsAreExactToTheLastDigit) {
  EXPECT_EQ(format_seconds(1'600'000'000'033'333'333), "1600000000.033333333");
  EXPECT_EQ(format_seconds(999'999'999), "0.999999999");
  EXPECT_EQ(format_seconds(-1'500'000'000), "-1.500000000");
  EXPECT_EQ(format_seconds(std::numeric_limits<std::int64_t>::max()), "9223372036.854775807");
  EXPECT_EQ(format_seconds(std::numeric_limits<std::int64_t>::min()), "-9223372036.854775808");
}

TEST(Decimal, SecondsAreReadBackToTheLastDigit) {
  for (const std::int64_t time_ns :
       {std::int64_t{0}, std::int64_t{-1}, std::int64_t{1'600'000'000'033'333'333},
        std::numeric_limits<std::int64_t>::max(), std::numeric_limits<std::int64_t>::min()}) {
    EXPECT_EQ(parse_seconds(format_seconds(time_ns)), time_ns);
  }
  for (const char* text :
       {"", "-", "1", "1.", ".5", "1.5", "1.0000000000", "1.00000000x", " 1.000000000",
        "+1.000000000", "--1.000000000", "1.-00000000", "9223372036.854775808",
        "-9223372036.854775809", "9223372037.000000000", "99999999999999999999.000000000"}) {
    EXPECT_FALSE(parse_seconds(text)) << text;
  }
}

TEST(Decimal, SplitSecondsCountForwardsFromAWholeSecondAtAnyTime) {
  EXPECT_EQ(split_seconds(1'633'012'000), (SplitTime{1, 633'012'000}));
  EXPECT_EQ(split_seconds(0), (SplitTime{0, 0}));
  EXPECT_EQ(split_seconds(-1), (SplitTime{-1, 999'999'999}));
  EXPECT_EQ(split_seconds(-2'000'000'000), (SplitTime{-2, 0}));
  EXPECT_EQ(split_seconds(std::numeric_limits<std::int64_t>::min()),
            (SplitTime{-9'223'372'037, 145'224'192}));
}

}  // namespace
}  // namespace orbbuf
