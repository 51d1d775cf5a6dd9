// SPDX-License-Identifier: Apache-2.0
#include "common/drop_record.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace orbbuf {
namespace {

TEST(DropRecord, CsvLineNamesFrameReasonAndTime) {
  EXPECT_EQ(to_csv({17, 1'633'012'000, DropReason::kPolicy}), "17,policy,1.633012000\n");
  EXPECT_EQ(to_csv({18, 0, DropReason::kBusy}), "18,busy,0.000000000\n");
  EXPECT_EQ(to_csv({19, 5, DropReason::kFailed}), "19,failed,0.000000005\n");
  EXPECT_EQ(to_csv({20, -5, DropReason::kShutdown}), "20,shutdown,-0.000000005\n");
}

TEST(DropRecord, ARangeHasALineForEachFrame) {
  const DropRecord range{7, 100, DropReason::kBusy, kUnknownSimilarity, 3, 201};
  EXPECT_EQ(range.end(), 10U);
  EXPECT_EQ(to_csv(range), "7,busy,0.000000100\n8,busy,0.000000151\n9,busy,0.000000201\n");
  EXPECT_EQ(to_csv({7, 100, DropReason::kBusy, 0, 2, 90}),
            "7,busy,0.000000100\n8,busy,0.000000090\n");
}

TEST(DropRecord, TheTimeOfASingleFrameIsItsOwn) {
  const DropRecord single{7, 100, DropReason::kBusy, kUnknownSimilarity, 1, 201};
  EXPECT_EQ(single.capture_time_of(7), 100);
}

TEST(DropRecord, TheEndsOfARangeKeepTheirTimes) {
  constexpr std::int64_t kTime = 1'600'000'000'123'456'789;
  for (const std::uint64_t frames : {2U, 3U, 29U, 100'000U, 0xFFFF'FFFFU}) {
    const DropRecord range{0,
                           kTime,
                           DropReason::kBusy,
                           kUnknownSimilarity,
                           frames,
                           kTime + 86'400'000'000'001};  // a day
    EXPECT_EQ(range.capture_time_of(0), kTime);
    EXPECT_EQ(range.capture_time_of(frames - 1), range.last_capture_time_ns) << frames;
  }
}

TEST(DropRecord, TimesThatARobotMadeUpDoNoHarm) {
  constexpr auto kFirst = std::numeric_limits<std::int64_t>::min();
  constexpr auto kLast = std::numeric_limits<std::int64_t>::max();
  const DropRecord range{0, kFirst, DropReason::kBusy, 0, 3, kLast};
  EXPECT_EQ(range.capture_time_of(0), kFirst);
  range.capture_time_of(1);  // any; the sanitizers look
  EXPECT_EQ(range.capture_time_of(2), kLast);
}

TEST(DropRecord, AListCanBeCutToTheFirstFrames) {
  const std::vector<DropRecord> all = {{7, 100, DropReason::kBusy},
                                       {10, 0, DropReason::kBusy, 0, Sequence{1} << 63, 50},
                                       {5, 100, DropReason::kBusy}};
  const auto cut_to = [&](std::uint64_t most) {
    auto records = all;
    EXPECT_TRUE(cut(records, most));
    std::uint64_t frames = 0;
    for (const DropRecord& record : records) frames += record.frames;
    EXPECT_EQ(frames, most);
    return records;
  };
  EXPECT_EQ(cut_to(0).size(), 0U);
  EXPECT_EQ(cut_to(1).size(), 1U);
  EXPECT_EQ(cut_to(2).back(), (DropRecord{10, 0, DropReason::kBusy, 0}));
  const DropRecord part = cut_to(4).back();
  EXPECT_EQ(part.frames, 3U);
  EXPECT_EQ(part.last_capture_time_ns, all[1].capture_time_of(12));
  EXPECT_EQ(cut_to((Sequence{1} << 63) + 1).size(), 2U);
  auto records = all;
  EXPECT_FALSE(cut(records, (Sequence{1} << 63) + 2));
  EXPECT_EQ(records, all);
}

}  // namespace
}  // namespace orbbuf
