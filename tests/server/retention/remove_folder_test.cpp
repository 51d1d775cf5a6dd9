// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <unistd.h>

#include "server/retention/retention.hpp"
#include "tests/server/retention/sessions_on_disk.hpp"

namespace orbbuf {
namespace {

namespace fs = std::filesystem;
using std::chrono::steady_clock;

TEST(RemoveFolder, RemovesAllOfItAndFollowsNoLink) {
  const test::TemporaryFolder folder;
  test::make_session(folder.path(), "r/s", 3);
  fs::create_directories(folder / "r/s/mine/deeper");
  test::write_file(folder / "kept", "text");
  fs::create_directories(folder / "kept_folder");
  test::write_file(folder / "kept_folder/kept", "text");
  ASSERT_EQ(::symlink((folder / "kept").c_str(), (folder / "r/s/link").c_str()), 0);
  ASSERT_EQ(::symlink((folder / "kept_folder").c_str(), (folder / "r/s/mine/link").c_str()), 0);
  const auto is_gone = remove_folder(folder / "r/s", steady_clock::time_point::max());
  ASSERT_TRUE(is_gone);
  EXPECT_TRUE(is_gone.value());
  EXPECT_TRUE(fs::is_empty(folder / "r"));
  EXPECT_TRUE(fs::exists(folder / "kept"));
  EXPECT_TRUE(fs::exists(folder / "kept_folder/kept"));
}

TEST(RemoveFolder, StopsAtTheDeadlineAndGoesOn) {
  const test::TemporaryFolder folder;
  test::make_session(folder.path(), "r/s", 10);
  int steps = 0;
  while (true) {
    const auto is_gone = remove_folder(folder / "r/s", steady_clock::time_point::min());
    ASSERT_TRUE(is_gone);
    if (is_gone.value()) break;
    ASSERT_LT(++steps, 100) << "the folder is not gone";
  }
  EXPECT_EQ(steps, 26);  // 20 images in two folders, the journal, three lists
  EXPECT_FALSE(fs::exists(folder / "r/s"));
}

TEST(RemoveFolder, WhatIsNotThereIsGone) {
  const test::TemporaryFolder folder;
  const auto is_gone = remove_folder(folder / "nothing", steady_clock::time_point::max());
  ASSERT_TRUE(is_gone);
  EXPECT_TRUE(is_gone.value());
}

TEST(RemoveFolder, WhatIsNoFolderIsAnError) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "file", "text");
  const auto is_gone = remove_folder(folder / "file", steady_clock::time_point::max());
  ASSERT_FALSE(is_gone);
  EXPECT_NE(is_gone.error().text.find("file: Not a directory"), std::string::npos);
}

}  // namespace
}  // namespace orbbuf
