// SPDX-License-Identifier: Apache-2.0
#include "server/recording/backlog.hpp"

#include <gtest/gtest.h>

#include "server/recording/session_files.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

using test::plain_frame;
using test::plain_pair;
using test::reduced_frame;

class BacklogTest : public testing::Test {
 protected:
  void keep(const EncodedFrame& frame) { EXPECT_FALSE(files_.write(frame)); }
  /// The next frame; null if there is none.
  FramePtr next(Sequence first) {
    auto frame = backlog_.next(first);
    EXPECT_TRUE(frame);
    return frame ? frame.value() : nullptr;
  }
  Sequence next_sequence(Sequence first) {
    const auto frame = next(first);
    return frame ? frame->sequence : kNone;
  }

  static constexpr Sequence kNone = ~Sequence{0};
  test::TemporaryFolder parent_;
  std::filesystem::path folder_ = parent_ / "r" / "s";
  SessionFiles files_{folder_, ""};
  Backlog backlog_{folder_};
};

TEST_F(BacklogTest, GivesFramesBackAsTheyWereKept) {
  EncodedFrame frame = plain_frame(7, 1000);
  frame.capture_time_ns = -1'500'000'001;
  keep(frame);
  const auto got = next(0);
  ASSERT_TRUE(got);
  EXPECT_EQ(got->sequence, 7U);
  EXPECT_EQ(got->capture_time_ns, -1'500'000'001);
  EXPECT_EQ(got->jpeg, frame.jpeg);
  EXPECT_FALSE(got->is_stereo());
}

TEST_F(BacklogTest, GivesBothImagesOfAStereoFrame) {
  const EncodedFrame frame = plain_pair(1, 300, 200);
  keep(frame);
  const auto got = next(0);
  ASSERT_TRUE(got && got->is_stereo());
  EXPECT_EQ(test::as_text(got->left()), test::as_text(frame.left()));
  EXPECT_EQ(test::as_text(got->right()), test::as_text(frame.right()));
}

TEST_F(BacklogTest, GivesBackWhatIsKnownOfAFramesQuality) {
  constexpr Sequence kFrames = 1000;  // some blocks of quality.csv
  for (Sequence i = 0; i < kFrames; ++i) {
    keep(i % 3 == 0 ? plain_frame(i) : reduced_frame(i, static_cast<std::uint8_t>(i % 100 + 1)));
  }
  const auto expect_known = [&](Sequence sequence) {
    const auto got = next(sequence);
    ASSERT_TRUE(got && got->sequence == sequence);
    const bool is_known = sequence % 3 != 0;
    EXPECT_EQ(got->quality, is_known ? sequence % 100 + 1 : 0);
    EXPECT_EQ(got->whole_bytes, is_known ? 40'123U : 0U);
    EXPECT_EQ(got->whole_crc, is_known ? 0x0A1B2C3DU : 0U);
  };
  for (Sequence i = 500; i < kFrames; ++i) expect_known(i);
  for (const Sequence i : {10U, 11U, 12U}) expect_known(i);  // it begins again
}

TEST_F(BacklogTest, OfTwoQualitiesTheLastCounts) {
  keep(reduced_frame(0));
  const std::string listed = test::read_file(folder_ / "quality.csv");
  test::write_file(folder_ / "quality.csv", listed + "1,20,40123,00000000\n");  // not accepted
  keep(reduced_frame(1, 50));
  keep(reduced_frame(2, 60));
  EXPECT_EQ(next(0)->quality, 30);
  EXPECT_EQ(next(1)->quality, 50);
  EXPECT_EQ(next(2)->quality, 60);
}

TEST_F(BacklogTest, QualitiesOfLateFramesStandBehindTheOthers) {
  for (const Sequence i : {0U, 1U, 2U}) keep(reduced_frame(i, 30));
  const std::string listed = test::read_file(folder_ / "quality.csv");
  test::write_file(folder_ / "quality.csv", listed + "1,80,0,00000000\n");
  keep(reduced_frame(3, 40));
  for (const auto& [sequence, quality] : {std::pair(0, 30), {1, 30}, {2, 30}, {3, 40}}) {
    EXPECT_EQ(next(static_cast<Sequence>(sequence))->quality, quality) << sequence;
  }
}

TEST_F(BacklogTest, GoesOnWithWhatCameMeanwhile) {
  EXPECT_EQ(next_sequence(0), kNone);  // not even a folder
  keep(plain_frame(0));
  keep(plain_frame(2));
  EXPECT_EQ(next_sequence(0), 0U);
  EXPECT_EQ(next_sequence(1), 2U);
  EXPECT_EQ(next_sequence(3), kNone);
  keep(plain_frame(3));
  EXPECT_EQ(next_sequence(3), 3U);
}

TEST_F(BacklogTest, BeginsAnywhereInALongSession) {
  constexpr Sequence kFrames = 1000;  // some blocks of times.txt
  for (Sequence i = 0; i < kFrames; ++i) keep(plain_frame(i, 10));
  for (Sequence i = 500; i < kFrames; ++i) ASSERT_EQ(next_sequence(i), i);
  EXPECT_EQ(next_sequence(kFrames), kNone);
  EXPECT_EQ(next_sequence(10), 10U);  // and begins again
}

TEST_F(BacklogTest, ALineThatIsBeingWrittenIsNotThereYet) {
  keep(plain_frame(0));
  test::write_file(folder_ / "times.txt", "0 1.000000000 0.0000");
  EXPECT_EQ(next_sequence(0), kNone);
  test::write_file(folder_ / "times.txt", "0 1.000000000 0.000000\n");
  EXPECT_EQ(next_sequence(0), 0U);
}

TEST_F(BacklogTest, AFrameThatSomebodyRemovedIsPassedOver) {
  const test::CapturedLog log;
  keep(plain_frame(0));
  keep(plain_frame(1));
  std::filesystem::remove(folder_ / "images/000000.jpg");
  EXPECT_EQ(next_sequence(0), 1U);
  EXPECT_EQ(
      log.lines("passed over frame 0: read " + (folder_ / "images/000000.jpg").string()).size(),
      1U);
}

TEST_F(BacklogTest, AListThatCannotBeReadIsAnError) {
  std::filesystem::create_directories(folder_ / "times.txt");
  EXPECT_FALSE(backlog_.next(0));
}

}  // namespace
}  // namespace orbbuf
