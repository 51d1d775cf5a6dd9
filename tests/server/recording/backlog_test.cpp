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
