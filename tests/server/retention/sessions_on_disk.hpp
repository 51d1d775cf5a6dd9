// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <filesystem>
#include <string>

#include "server/session/session_store.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/frames.hpp"

namespace orbbuf::test {

/// Makes PATH/`name` (ROBOT/SESSION) a real session, last written to so long ago.
inline void make_session(const std::filesystem::path& path, const std::string& name,
                         Sequence frames, std::chrono::seconds age = std::chrono::seconds(0)) {
  {
    const auto store = SessionStore::open(path / name, {"r", "s", "", {}}, Durability::kSecond);
    ASSERT_TRUE(store);
    for (Sequence sequence = 0; sequence < frames; ++sequence) {
      ASSERT_FALSE(store.value()->write(plain_pair(sequence, 50'000, 30'000), 0));
    }
    ASSERT_FALSE(store.value()->finish(true));
  }
  const auto then = std::filesystem::file_time_type::clock::now() - age;
  for (const auto& entry : std::filesystem::directory_iterator(path / name)) {
    std::filesystem::last_write_time(entry.path(), then);
  }
}

/// What du(1) says of the folder's content.
inline std::uint64_t disk_usage(const std::filesystem::path& folder) {
  std::uint64_t bytes = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    struct stat status {};
    EXPECT_EQ(::lstat(entry.path().c_str(), &status), 0);
    bytes += static_cast<std::uint64_t>(status.st_blocks) * 512;
  }
  return bytes;
}

}  // namespace orbbuf::test
