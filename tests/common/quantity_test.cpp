// SPDX-License-Identifier: Apache-2.0
#include "common/quantity.hpp"

#include <gtest/gtest.h>

namespace orbbuf {
namespace {

using std::chrono::nanoseconds;

TEST(Quantity, DurationIsANumberAndAUnit) {
  EXPECT_EQ(parse_duration("250 ms"), nanoseconds(250'000'000));
  EXPECT_EQ(parse_duration("1.5 s"), nanoseconds(1'500'000'000));
  EXPECT_EQ(parse_duration("2min"), nanoseconds(120'000'000'000));
  EXPECT_EQ(parse_duration("1 h"), nanoseconds(3'600'000'000'000));
  EXPECT_EQ(parse_duration("7us"), nanoseconds(7'000));
  EXPECT_EQ(parse_duration("0.1 ms"), nanoseconds(100'000));
  EXPECT_EQ(parse_duration("9 ns"), nanoseconds(9));
  EXPECT_EQ(parse_duration("0 s"), nanoseconds(0));
  EXPECT_EQ(parse_duration("-20 ms"), nanoseconds(-20'000'000));
}

TEST(Quantity, WhatIsNoDurationIsRefused) {
  for (const auto* text : {"",       " ",    "5",     "ms",      "5 parsecs", "5  s",  " 5 s",
                           "5 s ",   "5 S",  "s 5",   "1e3 s",   "0x10 s",    "nan s", "inf s",
                           "-inf s", "+5 s", "1,5 s", "1.2.3 s", "5 s 3 ms",  "- 5 s"}) {
    EXPECT_EQ(parse_duration(text), std::nullopt) << text;
  }
}

TEST(Quantity, DurationOf292YearsIsTooLong) {
  EXPECT_TRUE(parse_duration("2562047 h"));
  EXPECT_FALSE(parse_duration("2562048 h"));
  EXPECT_FALSE(parse_duration("-2562048 h"));
  EXPECT_FALSE(parse_duration("9223372036854775808 ns"));
  EXPECT_FALSE(parse_duration(std::string(400, '9') + " s"));
}

TEST(Quantity, SizeIsANumberAndAUnit) {
  EXPECT_EQ(parse_bytes("512 B"), 512U);
  EXPECT_EQ(parse_bytes("16 KiB"), 16384U);
  EXPECT_EQ(parse_bytes("1.5 KiB"), 1536U);
  EXPECT_EQ(parse_bytes("4MiB"), 4U << 20);
  EXPECT_EQ(parse_bytes("1 GiB"), 1U << 30);
  EXPECT_EQ(parse_bytes("2 TiB"), 2ULL << 40);
  EXPECT_EQ(parse_bytes("0 B"), 0U);
}

TEST(Quantity, WhatIsNoSizeIsRefused) {
  for (const auto* text : {"", "5", "5 kB", "5 KB", "5 K", "-1 B", "-0 B", "nan B", "inf GiB",
                           "5 b", "9000000000 GiB", "B"}) {
    EXPECT_EQ(parse_bytes(text), std::nullopt) << text;
  }
}

TEST(Quantity, WrittenInTheLargestUnitWithoutAFraction) {
  EXPECT_EQ(format_duration(nanoseconds(1'500'000'000)), "1500 ms");
  EXPECT_EQ(format_duration(nanoseconds(120'000'000'000)), "2 min");
  EXPECT_EQ(format_duration(nanoseconds(7'200'000'000'000)), "2 h");
  EXPECT_EQ(format_duration(nanoseconds(0)), "0 s");
  EXPECT_EQ(format_duration(nanoseconds(-1)), "-1 ns");
  EXPECT_EQ(format_duration(nanoseconds::min()), "-9223372036854775808 ns");
  EXPECT_EQ(format_bytes(0), "0 B");
  EXPECT_EQ(format_bytes(1536), "1536 B");
  EXPECT_EQ(format_bytes(16384), "16 KiB");
  EXPECT_EQ(format_bytes(std::uint64_t{5} << 30), "5 GiB");
  EXPECT_EQ(format_bytes(std::uint64_t{3} << 40), "3 TiB");
  EXPECT_EQ(format_bytes(~std::uint64_t{0}), "18446744073709551615 B");
}

}  // namespace
}  // namespace orbbuf
