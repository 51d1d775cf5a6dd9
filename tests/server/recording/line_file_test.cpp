// SPDX-License-Identifier: Apache-2.0
#include "server/recording/line_file.hpp"

#include <gtest/gtest.h>

#include "testing/temporary_folder.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf {
namespace {

class LineFileTest : public testing::Test {
 protected:
  std::string content() const { return test::read_file(path_); }
  LineFile::Content recovered() {
    auto found = LineFile(path_).recover();
    EXPECT_TRUE(found);
    return found ? found.value() : LineFile::Content{};
  }

  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_ / "lines.txt";
};

TEST_F(LineFileTest, AFileThatIsNotThereIsEmptyAndStaysAbsent) {
  EXPECT_EQ(recovered().lines, 0U);
  EXPECT_FALSE(std::filesystem::exists(path_));
}

TEST_F(LineFileTest, TheFirstLineIsWrittenOnce) {
  LineFile file(path_, "head");
  EXPECT_FALSE(file.append("one\n"));
  EXPECT_FALSE(file.append("two\nthree\n"));
  EXPECT_EQ(content(), "head\none\ntwo\nthree\n");
  EXPECT_EQ(recovered().lines, 4U);
  EXPECT_EQ(recovered().last, "three");
}

TEST_F(LineFileTest, ATornLastLineIsCutOff) {
  test::write_file(path_, "one\ntwo\nthr");
  EXPECT_EQ(recovered().lines, 2U);
  EXPECT_EQ(recovered().last, "two");
  EXPECT_EQ(content(), "one\ntwo\n");
}

TEST_F(LineFileTest, AFileOfOneTornLineBecomesEmpty) {
  test::write_file(path_, "hea");
  EXPECT_EQ(recovered().lines, 0U);
  EXPECT_EQ(content(), "");
}

TEST_F(LineFileTest, LinesAcrossReadBlocksAreCountedOnce) {
  std::string text;
  for (int i = 0; i < 20000; ++i) text += std::to_string(i) + " some words\n";
  test::write_file(path_, text + std::string(1000, 'z'));
  EXPECT_EQ(recovered().lines, 20000U);
  EXPECT_EQ(recovered().last, "19999 some words");
  EXPECT_EQ(content(), text);
}

TEST_F(LineFileTest, AnAppendThatFailsHalfwayLeavesNothing) {
  LineFile file(path_);
  EXPECT_FALSE(file.append("0123456789\n"));
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, 15);
    const auto error = file.append("0123456789\n");
    ASSERT_TRUE(error);
    EXPECT_EQ(error->text, "write " + path_.string() + ": File too large");
  }
  EXPECT_EQ(content(), "0123456789\n");
  EXPECT_FALSE(file.append("again\n"));
  EXPECT_EQ(content(), "0123456789\nagain\n");
}

TEST_F(LineFileTest, AFileThatSomebodyRemovedComesBack) {
  LineFile file(path_, "head");
  EXPECT_FALSE(file.append("one\n"));
  std::filesystem::remove(path_);
  EXPECT_FALSE(file.append("two\n"));
  EXPECT_EQ(content(), "head\ntwo\n");
}

TEST_F(LineFileTest, AFileThatCannotBeReadIsAnError) {
  std::filesystem::create_directory(path_);
  const auto found = LineFile(path_).recover();
  ASSERT_FALSE(found);
  EXPECT_EQ(found.error().text, "open " + path_.string() + ": Is a directory");
}

}  // namespace
}  // namespace orbbuf
