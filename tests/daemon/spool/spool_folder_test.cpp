// SPDX-License-Identifier: Apache-2.0
#include "daemon/spool/spool_folder.hpp"

#include <gmock/gmock.h>
#include <unistd.h>

#include <limits>
#include <stdexcept>

#include "testing/temporary_folder.hpp"

namespace orbbuf::test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class SpoolFolderTest : public testing::Test {
 protected:
  std::string error() const {
    try {
      SpoolFolder(path(), "robot");
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  }
  std::filesystem::path path() const { return folder_ / "deep" / "spool"; }

  const TemporaryFolder folder_;
};

TEST_F(SpoolFolderTest, MakesTheFolderWithAllAboveIt) {
  const SpoolFolder folder(path(), "robot");
  EXPECT_TRUE(std::filesystem::is_directory(path()));
  EXPECT_THAT(folder.segments(), IsEmpty());
  EXPECT_FALSE(folder.read_cursor());
}

TEST_F(SpoolFolderTest, NamesOfSegmentsSortAsTheirNumbers) {
  const SpoolFolder folder(path(), "robot");
  const std::uint64_t most = std::numeric_limits<std::uint64_t>::max();
  for (const std::uint64_t number : {most, std::uint64_t{10}, std::uint64_t{9}}) {
    write_file(folder.segment(number), "");
  }
  write_file(path() / "9.segment", "");
  EXPECT_EQ(folder.segment(9).filename(), "000000000009.segment");
  EXPECT_THAT(folder.segments(), ElementsAre(9, 10, most));
  EXPECT_TRUE(folder.remove(9));
  EXPECT_TRUE(folder.remove(9));
  EXPECT_THAT(folder.segments(), ElementsAre(10, most));
}

TEST_F(SpoolFolderTest, TheCursorIsReadBack) {
  const SpoolCursor cursor = {17, 1ULL << 40};
  {
    SpoolFolder folder(path(), "robot");
    EXPECT_FALSE(folder.write_cursor({3, 4}));
    EXPECT_FALSE(folder.write_cursor(cursor));
    EXPECT_FALSE(folder.sync());
    EXPECT_EQ(folder.read_cursor(), cursor);
  }
  EXPECT_FALSE(SpoolFolder(path(), "other").read_cursor());
  EXPECT_EQ(SpoolFolder(path(), "robot").read_cursor(), cursor);
}

TEST_F(SpoolFolderTest, ADamagedOrShortCursorIsNone) {
  { EXPECT_FALSE(SpoolFolder(path(), "robot").write_cursor({17, 5})); }
  const auto file = path() / "robot.cursor";
  const auto whole = read_file(file);
  EXPECT_EQ(whole.size(), 26U);
  for (std::size_t offset = 0; offset < whole.size(); ++offset) {
    auto bytes = whole;
    bytes[offset] = static_cast<char>(bytes[offset] ^ 1);
    write_file(file, bytes);
    EXPECT_FALSE(SpoolFolder(path(), "robot").read_cursor()) << offset;
    write_file(file, whole.substr(0, offset));
    EXPECT_FALSE(SpoolFolder(path(), "robot").read_cursor()) << offset;
  }
}

TEST_F(SpoolFolderTest, OnlyOneMayUseIt) {
  const SpoolFolder folder(path(), "robot");
  EXPECT_THAT(error(), HasSubstr("cannot use the spool " + path().string() + ": another orbbufd"));
}

TEST_F(SpoolFolderTest, AFolderThatCannotBeMadeIsNamed) {
  write_file(folder_ / "deep", "");
  EXPECT_THAT(error(), HasSubstr("cannot make the spool " + path().string()));
}

TEST_F(SpoolFolderTest, AFolderThatCannotBeWrittenIsNamed) {
  using std::filesystem::perms;
  std::filesystem::create_directories(path());
  std::filesystem::permissions(path(), perms::owner_read | perms::owner_exec);
  std::filesystem::permissions(folder_.path(), perms::others_exec,
                               std::filesystem::perm_options::add);
  constexpr uid_t kNobody = 65534;
  const uid_t user = ::geteuid();
  if (user == 0) {  // who may write everywhere
    ASSERT_EQ(::seteuid(kNobody), 0);
  }
  const std::string said = error();
  ASSERT_EQ(::seteuid(user), 0);
  EXPECT_THAT(said, HasSubstr("Permission denied; change spool.path"));
}

}  // namespace
}  // namespace orbbuf::test
