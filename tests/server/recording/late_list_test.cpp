// SPDX-License-Identifier: Apache-2.0
#include "server/recording/late_list.hpp"

#include <gtest/gtest.h>

#include "server/recording/false_tail.hpp"
#include "server/recording/late_files.hpp"
#include "server/recording/late_merge.hpp"
#include "testing/captured_log.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using test::plain_frame;
using test::read_file;

class LateListTest : public testing::Test {
 protected:
  void add(Sequence first, Sequence end) const {
    LateFiles late(folder_);
    for (Sequence i = first; i < end; ++i) ASSERT_TRUE(late.write(plain_frame(i), 0));
  }
  void remove_image(Sequence number) const { ASSERT_TRUE(fs::remove(folder_ / image_of(number))); }
  static std::string image_of(Sequence number) {
    return fmt::format("late/images/{:06}.jpg", number);
  }
  std::size_t recovered() const {
    const auto late = recover_late(folder_);
    EXPECT_TRUE(late);
    return late ? late.value().size() : 0;
  }

  test::TemporaryFolder parent_;
  fs::path folder_ = parent_ / "robot" / "session";
  const test::CapturedLog log_;
};

TEST_F(LateListTest, OfNothingIsEmpty) {
  EXPECT_TRUE(read_late(folder_).value().empty());
  EXPECT_EQ(recovered(), 0U);
  EXPECT_FALSE(fs::exists(folder_));
}

TEST_F(LateListTest, HasTheFramesAsTheyCame) {
  add(8, 10);
  add(3, 5);
  const auto late = read_late(folder_).value();
  ASSERT_EQ(late.size(), 4U);
  EXPECT_EQ(late[2].sequence, 3U);
  EXPECT_EQ(late[2].crc, plain_frame(3).jpeg_crc);
  EXPECT_EQ(recover_late(folder_).value(), late);
  EXPECT_EQ(numbers_of(late).runs(), (std::map<Sequence, Sequence>{{3, 5}, {8, 10}}));
}

TEST_F(LateListTest, ReadingPassesOverWhatIsTornAndChangesNothing) {
  add(0, 2);
  const auto text = read_file(folder_ / "late.csv") + "my notes\n2,0.08";
  test::write_file(folder_ / "late.csv", text);
  EXPECT_EQ(read_late(folder_).value().size(), 2U);
  EXPECT_EQ(read_file(folder_ / "late.csv"), text);
}

TEST_F(LateListTest, EndsBeforeTheOldestFalseFrameAmongTheNewest) {
  add(0, 10);
  const auto text = read_file(folder_ / "late.csv");
  remove_image(4);
  test::write_file(folder_ / image_of(8), std::string(100, '\0'));
  EXPECT_EQ(recovered(), 4U);
  EXPECT_EQ(read_file(folder_ / "late.csv") + read_file(folder_ / "orphans/late.csv"), text);
  EXPECT_FALSE(fs::exists(folder_ / image_of(9)));
  EXPECT_TRUE(fs::exists(folder_ / "orphans" / image_of(9)));
  EXPECT_TRUE(fs::exists(folder_ / image_of(3)));
  EXPECT_EQ(log_.lines("6 frames at the end of late.csv are not whole").size(), 1U);
  EXPECT_EQ(recovered(), 4U);
}

TEST_F(LateListTest, IsBelievedOnceSoManyFramesAreWhole) {
  add(0, kTrueRun + 2);
  remove_image(0);
  EXPECT_EQ(recovered(), kTrueRun + 2);
  remove_image(2);
  EXPECT_EQ(recovered(), 0U);  // from 2 back to 0 there are not so many
}

TEST_F(LateListTest, OfWhatIsMergedTheImagesAreNotLookedAt) {
  add(0, 3);
  ASSERT_TRUE(merge_late(folder_));
  ASSERT_TRUE(fs::remove(folder_ / "images/000001.jpg"));
  add(3, 5);
  EXPECT_EQ(recovered(), 5U);
  remove_image(3);
  EXPECT_EQ(recovered(), 3U);
}

TEST_F(LateListTest, AnImageIsInLateUntilItIsMoved) {
  add(0, 1);
  EXPECT_EQ(place_of_late_image(folder_, "images/000000.jpg"), "late/images/000000.jpg");
  EXPECT_EQ(place_of_late_image(folder_, "images/000001.jpg"), "late/images/000001.jpg");
  fs::create_directories(folder_ / "images");
  fs::copy(folder_ / "late/images/000000.jpg", folder_ / "images/000000.jpg");
  EXPECT_EQ(place_of_late_image(folder_, "images/000000.jpg"), "late/images/000000.jpg");
  fs::remove(folder_ / "late/images/000000.jpg");
  EXPECT_EQ(place_of_late_image(folder_, "images/000000.jpg"), "images/000000.jpg");
  EXPECT_EQ(recovered(), 1U);
}

}  // namespace
}  // namespace orbbuf
