// SPDX-License-Identifier: Apache-2.0
#include "common/file_io.hpp"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <vector>

#include "testing/temporary_folder.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf {
namespace {

const std::vector<std::uint8_t> kBytes(5000, 'x');

TEST(ReadRegular, ReadsFilesOnlyAndWaitsForNoWriter) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "a", "text");
  ASSERT_EQ(::mkfifo((folder / "fifo").c_str(), 0600), 0);
  EXPECT_EQ(read_regular(folder / "a").value(), (std::vector<std::uint8_t>{'t', 'e', 'x', 't'}));
  EXPECT_EQ(read_regular(folder / "fifo").error().text,
            "open " + (folder / "fifo").string() + ": it is a FIFO or a device, not a file");
  EXPECT_EQ(read_regular(folder / "no").error().text,
            "read " + (folder / "no").string() + ": No such file or directory");
  EXPECT_FALSE(open_regular(folder / "no").value());
}

TEST(WriteFile, ReplacesTheFileAndLeavesNoTemporary) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "a", "before");
  EXPECT_FALSE(write_file(folder / "a", folder / "t", kBytes));
  EXPECT_EQ(test::read_file(folder / "a"), std::string(5000, 'x'));
  EXPECT_FALSE(std::filesystem::exists(folder / "t"));
}

TEST(WriteFile, OnAFullDiskKeepsWhatWasThere) {
  const test::TemporaryFolder folder;
  test::write_file(folder / "a", "before");
  const test::ResourceLimit full(RLIMIT_FSIZE, 1000);
  const auto error = write_file(folder / "a", folder / "t", kBytes);
  ASSERT_TRUE(error);
  EXPECT_EQ(error->text, "write " + (folder / "t").string() + ": File too large");
  EXPECT_EQ(test::read_file(folder / "a"), "before");
  EXPECT_FALSE(std::filesystem::exists(folder / "t"));
}

TEST(WriteFile, NamesAFolderThatIsNotThere) {
  const test::TemporaryFolder folder;
  const auto error = write_file(folder / "no" / "a", folder / "t", kBytes);
  ASSERT_TRUE(error);
  EXPECT_NE(error->text.find("No such file or directory"), std::string::npos);
  EXPECT_FALSE(std::filesystem::exists(folder / "t"));
}

}  // namespace
}  // namespace orbbuf
