// SPDX-License-Identifier: Apache-2.0
#include "common/drop_record.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace orbbuf {
namespace {

TEST(DropRecord, CsvLineNamesFrameReasonAndTime) {
  EXPECT_EQ(to_csv({17, 1'633'012'000, DropReason::kPolicy}), "17,policy,1.633012000");
  EXPECT_EQ(to_csv({18, 0, DropReason::kBusy}), "18,busy,0.000000000");
  EXPECT_EQ(to_csv({19, 5, DropReason::kFailed}), "19,failed,0.000000005");
  EXPECT_EQ(to_csv({20, -5, DropReason::kShutdown}), "20,shutdown,-0.000000005");
}

TEST(DropRecord, SecondsAreExactToTheLastDigit) {
  EXPECT_EQ(format_seconds(1'600'000'000'033'333'333), "1600000000.033333333");
  EXPECT_EQ(format_seconds(999'999'999), "0.999999999");
  EXPECT_EQ(format_seconds(-1'500'000'000), "-1.500000000");
  EXPECT_EQ(format_seconds(std::numeric_limits<std::int64_t>::max()), "9223372036.854775807");
  EXPECT_EQ(format_seconds(std::numeric_limits<std::int64_t>::min()), "-9223372036.854775808");
}

TEST(DropRecord, CsvLinesAreReadBack) {
  for (const auto reason :
       {DropReason::kPolicy, DropReason::kBusy, DropReason::kFailed, DropReason::kShutdown}) {
    const DropRecord drop{std::numeric_limits<Sequence>::max(), -5, reason};
    EXPECT_EQ(drop_from_csv(to_csv(drop)), drop);
  }
  for (const char* line :
       {"", "17", "17,policy", "17,policy,1.633012", "-17,policy,1.633012000",
        "17,unknown,1.633012000", "17,policy,1.633012000,", "17,busy,policy,1.633012000"}) {
    EXPECT_FALSE(drop_from_csv(line)) << line;
  }
}

TEST(DropRecord, SecondsAreReadBackToTheLastDigit) {
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

TEST(SplitSeconds, CountsForwardsFromAWholeSecondAtAnyTime) {
  EXPECT_EQ(split_seconds(1'633'012'000), (SplitTime{1, 633'012'000}));
  EXPECT_EQ(split_seconds(0), (SplitTime{0, 0}));
  EXPECT_EQ(split_seconds(-1), (SplitTime{-1, 999'999'999}));
  EXPECT_EQ(split_seconds(-2'000'000'000), (SplitTime{-2, 0}));
  EXPECT_EQ(split_seconds(std::numeric_limits<std::int64_t>::min()),
            (SplitTime{-9'223'372'037, 145'224'192}));
}

}  // namespace
}  // namespace orbbuf
