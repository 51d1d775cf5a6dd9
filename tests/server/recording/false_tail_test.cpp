// SPDX-License-Identifier: Apache-2.0
#include "server/recording/false_tail.hpp"

#include <gtest/gtest.h>

#include "server/recording/session_files.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf {
namespace {

/// A session of `frames` frames.
class FalseTailTest : public testing::Test {
 protected:
  void record(Sequence frames) const {
    SessionFiles files(folder_.path(), "");
    for (Sequence i = 0; i < frames; ++i) ASSERT_FALSE(files.write(test::plain_frame(i)));
  }
  void empty(Sequence image) const { test::write_file(folder_ / session_image(image), ""); }
  static std::string session_image(Sequence image) {
    const std::string digits = std::to_string(image);
    return "images/" + std::string(6 - digits.size(), '0') + digits + ".jpg";
  }
  FalseTail found() const { return find_false_tail(folder_.path()).value(); }

  test::TemporaryFolder folder_;
};

TEST_F(FalseTailTest, NoFolderHasNone) {
  const auto tail = find_false_tail(folder_ / "missing");
  ASSERT_TRUE(tail);
  EXPECT_TRUE(tail.value().lines.empty());
}

TEST_F(FalseTailTest, BeginsAtTheOldestFalseFrame) {
  record(5);
  empty(2);
  empty(4);
  EXPECT_EQ(found().frames, 3U);
  EXPECT_EQ(found().last_true, Sequence{1});
}

TEST_F(FalseTailTest, MayBeAll) {
  record(2);
  empty(0);
  EXPECT_EQ(found().offset, 0U);
  EXPECT_EQ(found().frames, 2U);
  EXPECT_FALSE(found().last_true);
}

TEST_F(FalseTailTest, IsSoughtUntilEnoughFramesAreTrue) {
  record(kTrueRun + 2);
  empty(1);  // kTrueRun frames after it are true
  EXPECT_TRUE(found().lines.empty());
  empty(kTrueRun / 2);
  EXPECT_EQ(found().last_true, Sequence{0});
}

TEST_F(FalseTailTest, WhatIsNotThereIsNoOrphan) {
  EXPECT_EQ(move_to_orphans(folder_.path(), "incoming.tmp").value(), false);
  EXPECT_TRUE(std::filesystem::is_empty(folder_.path()));
}

}  // namespace
}  // namespace orbbuf
