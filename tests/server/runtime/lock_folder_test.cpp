// SPDX-License-Identifier: Apache-2.0
#include "server/runtime/lock_folder.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

TEST(LockFolder, RefusesASecondUserAndNamesTheFolder) {
  const test::TemporaryFolder folder;
  const UniqueFd lock = lock_folder(folder.path());
  try {
    lock_folder(folder.path());
    FAIL() << "locked twice";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr(folder.path().string()));
    EXPECT_THAT(error.what(), testing::HasSubstr("another orbbuf-server uses it"));
  }
}

TEST(LockFolder, EndsWithItsDescriptorAndLeavesNoFile) {
  const test::TemporaryFolder folder;
  { const UniqueFd lock = lock_folder(folder.path()); }
  EXPECT_TRUE(lock_folder(folder.path()));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(LockFolder, NeedsTheFolder) {
  const test::TemporaryFolder folder;
  EXPECT_THROW(lock_folder(folder / "missing"), std::runtime_error);
}

}  // namespace
}  // namespace orbbuf
