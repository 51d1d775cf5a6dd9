// SPDX-License-Identifier: Apache-2.0
#include "server/recording/late_files.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "server/recording/late_merge.hpp"
#include "server/recording/session_files.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using test::as_text;
using test::plain_frame;
using test::plain_pair;
using test::read_file;
using test::read_lines;

constexpr std::int64_t kArrivedNs = 1'763'779'406'123'456'789;

class LateFilesTest : public testing::Test {
 protected:
  SessionFiles live() const { return {folder_, ""}; }
  void deliver(const std::vector<Sequence>& numbers) const {
    auto files = live();
    for (const Sequence number : numbers) ASSERT_FALSE(files.write(plain_frame(number)));
  }

  /// Whether it was new, by an object that is new itself unless one is given.
  bool write(const EncodedFrame& frame) const {
    LateFiles late(folder_);
    return write(late, frame);
  }
  static bool write(LateFiles& late, const EncodedFrame& frame) {
    const auto is_new = late.write(frame, kArrivedNs);
    EXPECT_TRUE(is_new) << is_new.error().text;
    return is_new && is_new.value();
  }

  std::size_t lines() const { return read_lines(folder_ / "late.csv").size(); }
  std::string late_image(Sequence number) const {
    return read_file(folder_ / fmt::format("late/images/{:06}.jpg", number));
  }

  test::TemporaryFolder parent_;
  fs::path folder_ = parent_ / "robot" / "session";
};

TEST_F(LateFilesTest, StandBesideWhatCameLive) {
  deliver({0, 1, 5});
  const auto times = read_file(folder_ / "times.txt");
  LateFiles late(folder_);
  EncodedFrame known = plain_frame(7);
  known.quality = 80;
  EXPECT_TRUE(write(late, known));
  EXPECT_TRUE(write(late, plain_pair(3, 30, 40)));
  EXPECT_EQ(read_file(folder_ / "times.txt"), times);
  EXPECT_EQ(late_image(7), as_text(plain_frame(7).jpeg));
  EXPECT_EQ(late_image(3), as_text(plain_pair(3, 30, 40).left()));
  EXPECT_EQ(read_file(folder_ / "late/images_right/000003.jpg"),
            as_text(plain_pair(3, 30, 40).right()));
  EXPECT_EQ(read_file(folder_ / "late.csv"),
            fmt::format("sequence,capture_time_s,exposure_ms,crc,crc_right,arrived_s,quality\n"
                        "7,0.280000000,8.500000,{:08X},,1763779406.123456789,80\n"
                        "3,0.120000000,8.500000,{:08X},{:08X},1763779406.123456789,0\n",
                        plain_frame(7).jpeg_crc, wire::crc32(plain_pair(3, 30, 40).left()),
                        wire::crc32(plain_pair(3, 30, 40).right())));
  EXPECT_FALSE(fs::exists(folder_ / "late/incoming.tmp"));
}

TEST_F(LateFilesTest, AreTheFirstOfASessionIfNothingCameLive) {
  EXPECT_TRUE(write(plain_frame(2)));
  EXPECT_EQ(live().recover().value(), wire::Position{});
  EXPECT_EQ(late_image(2), as_text(plain_frame(2).jpeg));
}

TEST_F(LateFilesTest, AFrameIsTakenOnce) {
  deliver({0, 1});
  LateFiles late(folder_);
  EXPECT_FALSE(write(late, plain_frame(1)));
  EXPECT_FALSE(fs::exists(folder_ / "late.csv"));
  EXPECT_TRUE(write(late, plain_frame(2)));
  EXPECT_FALSE(write(late, plain_frame(2)));
  EXPECT_FALSE(write(plain_frame(2)));
  EXPECT_FALSE(write(plain_frame(0)));
  EXPECT_EQ(lines(), 2U);
}

TEST_F(LateFilesTest, WhatComesLiveMeanwhileIsKnown) {
  deliver({0});
  LateFiles late(folder_);
  EXPECT_FALSE(write(late, plain_frame(0)));
  auto files = live();
  ASSERT_TRUE(files.recover());
  for (Sequence i = 1; i < 4; ++i) {
    ASSERT_FALSE(files.write(plain_pair(i, 10, 20)));
    EXPECT_FALSE(write(late, plain_pair(i, 10, 20)));
  }
  EXPECT_EQ(lines(), 0U);
}

TEST_F(LateFilesTest, AnImageThatWasInTheMiddleOfBeingWrittenIsNoFrame) {
  deliver({0});
  test::write_file(folder_ / "images/000001.jpg", as_text(plain_frame(1).jpeg));
  EXPECT_TRUE(write(plain_frame(1)));
  EXPECT_EQ(late_image(1), as_text(plain_frame(1).jpeg));
}

TEST_F(LateFilesTest, ALineWhoseImageAPowerCutHasTakenIsNoFrame) {
  auto files = live();
  for (Sequence i = 0; i < 3; ++i) ASSERT_FALSE(files.write(plain_pair(i, 10, 20)));
  test::write_file(folder_ / "images/000000.jpg", std::string(10, '\0'));
  test::write_file(folder_ / "images_right/000001.jpg", std::string(20, '\0'));
  EXPECT_TRUE(write(plain_pair(0, 10, 20)));
  EXPECT_TRUE(write(plain_pair(1, 10, 20)));
  EXPECT_FALSE(write(plain_pair(2, 10, 20)));
}

TEST_F(LateFilesTest, ATornLineIsNoFrame) {
  EXPECT_TRUE(write(plain_frame(1)));
  const auto list = read_file(folder_ / "late.csv");
  test::write_file(folder_ / "late.csv", list + "2,0.08");
  EXPECT_TRUE(write(plain_frame(2)));
  EXPECT_EQ(lines(), 3U);
  EXPECT_FALSE(write(plain_frame(1)));
}

TEST_F(LateFilesTest, ALineWithoutItsImagesIsNoFrame) {
  const test::CapturedLog log;
  {
    LateFiles late(folder_);
    for (Sequence i = 0; i < 4; ++i) EXPECT_TRUE(write(late, plain_pair(i, 10, 20)));
  }
  fs::remove(folder_ / "late/images_right/000002.jpg");
  LateFiles late(folder_);
  EXPECT_FALSE(write(late, plain_pair(1, 10, 20)));
  EXPECT_TRUE(write(late, plain_pair(2, 10, 20)));
  EXPECT_TRUE(write(late, plain_pair(3, 10, 20)));
  EXPECT_EQ(lines(), 5U);
  EXPECT_EQ(log.lines("2 frames at the end of late.csv are not whole").size(), 1U);
}

TEST_F(LateFilesTest, WhatDoesNotFitLeavesNothing) {
  EXPECT_TRUE(write(plain_pair(0, 10, 10)));
  const auto list = read_file(folder_ / "late.csv");
  LateFiles late(folder_);
  for (const auto& [limit, frame] :
       {std::pair<std::size_t, EncodedFrame>{1000, plain_pair(1, 5000, 10)},
        {1000, plain_pair(1, 10, 5000)},
        {list.size() + 5, plain_pair(1, 10, 10)}}) {
    {
      const test::ResourceLimit full(RLIMIT_FSIZE, limit);
      EXPECT_FALSE(late.write(frame, kArrivedNs));
    }
    EXPECT_EQ(read_file(folder_ / "late.csv"), list);
    EXPECT_FALSE(fs::exists(folder_ / "late/images/000001.jpg"));
    EXPECT_FALSE(fs::exists(folder_ / "late/images_right/000001.jpg"));
    EXPECT_FALSE(fs::exists(folder_ / "late/incoming.tmp"));
  }
  EXPECT_TRUE(write(late, plain_pair(1, 10, 10)));
  EXPECT_EQ(lines(), 3U);
}

TEST_F(LateFilesTest, GoOnAfterAMerge) {
  deliver({0, 1, 5});
  LateFiles late(folder_);
  EXPECT_TRUE(write(late, plain_frame(3)));
  ASSERT_TRUE(merge_late(folder_));
  EXPECT_FALSE(write(late, plain_frame(3)));
  EXPECT_FALSE(write(plain_frame(3)));
  EXPECT_FALSE(fs::exists(folder_ / "late"));
  EXPECT_TRUE(write(late, plain_frame(4)));
  EXPECT_FALSE(write(plain_frame(4)));
  EXPECT_EQ(lines(), 3U);
  EXPECT_EQ(late_image(4), as_text(plain_frame(4).jpeg));
}

TEST_F(LateFilesTest, AFolderThatWasRemovedComesBack) {
  LateFiles late(folder_);
  EXPECT_TRUE(write(late, plain_frame(0)));
  fs::remove_all(folder_);
  EXPECT_TRUE(write(late, plain_frame(1)));
  EXPECT_EQ(lines(), 2U);
}

TEST_F(LateFilesTest, AListThatCannotBeReadIsAnError) {
  fs::create_directories(folder_ / "late.csv");
  EXPECT_FALSE(LateFiles(folder_).write(plain_frame(0), kArrivedNs));
  EXPECT_FALSE(fs::exists(folder_ / "late"));
}

TEST_F(LateFilesTest, NoteWhatTheRobotHolds) {
  deliver({0});
  LateFiles late(folder_);
  const auto spool = [&] { return read_file(folder_ / "spool.csv"); };
  EXPECT_FALSE(late.note({0, 0, kArrivedNs}));
  EXPECT_FALSE(fs::exists(folder_ / "spool.csv"));
  EXPECT_FALSE(late.note({12, 345, kArrivedNs}));
  EXPECT_EQ(spool(), "held,first,reported_s\n12,345,1763779406.123456789\n");
  EXPECT_FALSE(late.note({12, 346, 1}));
  EXPECT_EQ(spool(), "held,first,reported_s\n12,346,0.000000001\n");
  EXPECT_FALSE(LateFiles(folder_).note({11, 346, 2}));
  EXPECT_EQ(spool(), "held,first,reported_s\n11,346,0.000000002\n");
  EXPECT_FALSE(late.note({11, 346, 3}));
  EXPECT_EQ(spool(), "held,first,reported_s\n11,346,0.000000002\n") << "nothing has changed";
  EXPECT_FALSE(late.note({0, 346, 4}));
  EXPECT_EQ(spool(), "held,first,reported_s\n0,,0.000000004\n");
  EXPECT_FALSE(late.note({0, 0, 5}));
  EXPECT_EQ(spool(), "held,first,reported_s\n0,,0.000000004\n");
}

TEST_F(LateFilesTest, NoteNothingOfASessionThatIsNotThere) {
  EXPECT_FALSE(LateFiles(folder_).note({12, 345, 0}));
  EXPECT_FALSE(fs::exists(folder_));
}

TEST_F(LateFilesTest, ACountThatAPowerCutHasTornIsReplaced) {
  deliver({0});
  test::write_file(folder_ / "spool.csv", "held,fir");
  EXPECT_FALSE(LateFiles(folder_).note({0, 0, 0}));
  EXPECT_EQ(holds_from_csv(read_file(folder_ / "spool.csv")), RobotHolds{});
}

}  // namespace
}  // namespace orbbuf
