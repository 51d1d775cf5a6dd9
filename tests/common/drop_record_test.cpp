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
  EXPECT_EQ(to_csv({21, 0, DropReason::kLate}), "21,late,0.000000000");
}

TEST(DropRecord, CsvLinesAreReadBack) {
  for (const auto reason :
       {DropReason::kPolicy, DropReason::kBusy, DropReason::kFailed, DropReason::kShutdown,
        DropReason::kRefused, DropReason::kUnknown, DropReason::kLost, DropReason::kLate}) {
    const DropRecord drop{std::numeric_limits<Sequence>::max(), -5, reason};
    EXPECT_EQ(drop_from_csv(to_csv(drop)), drop);
  }
  for (const char* line :
       {"", "17", "17,policy", "17,policy,1.633012", "-17,policy,1.633012000",
        "17,gone,1.633012000", "17,policy,1.633012000,", "17,busy,policy,1.633012000"}) {
    EXPECT_FALSE(drop_from_csv(line)) << line;
  }
}

}  // namespace
}  // namespace orbbuf
