// SPDX-License-Identifier: Apache-2.0
#include "server/recording/segment_info.hpp"

#include <gtest/gtest.h>

#include "server/recording/session_files.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

TEST(SegmentInfo, IsReadAsItWasWritten) {
  const SegmentInfo segment{7, {1200, 35}};
  EXPECT_EQ(to_csv(segment), "epoch,next_sequence,next_drop\n7,1200,35\n");
  EXPECT_EQ(segment_from_csv(to_csv(segment)), segment);
}

TEST(SegmentInfo, WhatIsNotOneIsNothing) {
  for (const char* const text :
       {"", "7,1200,35\n", "epoch,next_sequence,next_drop\n",
        "epoch,next_sequence,next_drop\n7,1\n", "epoch,next_sequence,next_drop\n7,1,x\n",
        "epoch,next_sequence,next_drop\n7,1,2"}) {
    EXPECT_FALSE(segment_from_csv(text)) << text;
  }
}

TEST(SegmentInfo, TheFilesOfASegmentStandWhereItBeginsAndThenBehindWhatTheyHave) {
  const test::TemporaryFolder folder;
  const SegmentInfo segment{7, {10, 4}};
  SessionFiles files(folder / "s.e7", "", segment);
  EXPECT_EQ(files.recover().value(), (wire::Position{10, 4}));
  EXPECT_FALSE(files.write(test::plain_frame(11)));
  EXPECT_FALSE(files.write_drops({4, {{10, 0, DropReason::kPolicy}}}));
  SessionFiles again(folder / "s.e7", "", segment);
  EXPECT_EQ(again.recover().value(), (wire::Position{12, 5}));
  EXPECT_EQ(segment_from_csv(test::read_file(folder / "s.e7/segment.csv")), segment);
}

}  // namespace
}  // namespace orbbuf
