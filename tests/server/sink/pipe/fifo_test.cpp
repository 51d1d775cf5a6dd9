// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe/fifo.hpp"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>

#include "testing/temporary_folder.hpp"

namespace orbbuf {
namespace {

class FifoTest : public testing::Test {
 protected:
  UniqueFd read_end() const { return UniqueFd(::open(path_.c_str(), O_RDONLY | O_NONBLOCK)); }

  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_ / "robots" / "a.fifo";
};

TEST_F(FifoTest, IsMadeWithItsFolderAndHasNoReaderAtFirst) {
  Fifo fifo(path_);
  const auto end = fifo.connect({});
  ASSERT_TRUE(end);
  EXPECT_FALSE(end.value());
  EXPECT_TRUE(std::filesystem::is_fifo(path_));
}

TEST_F(FifoTest, OpensWhenSomebodyReads) {
  Fifo fifo(path_);
  EXPECT_TRUE(fifo.connect({}));
  const UniqueFd reader = read_end();
  const auto end = fifo.connect({});
  ASSERT_TRUE(end);
  EXPECT_TRUE(end.value());
}

TEST_F(FifoTest, TwoSessionsNeverMixTheirFramesInOnePipe) {
  Fifo first(path_);
  Fifo second(path_);
  EXPECT_TRUE(first.connect({}));
  const UniqueFd reader = read_end();
  {
    const auto writing = first.connect({});
    ASSERT_TRUE(writing && writing.value());
    const auto refused = second.connect({});
    ASSERT_TRUE(refused);
    EXPECT_FALSE(refused.value());
  }
  const auto writing = second.connect({});
  ASSERT_TRUE(writing);
  EXPECT_TRUE(writing.value());
}

TEST_F(FifoTest, WhatTheLastWriterLeftIsReadToItsEndBeforeTheNextOneBegins) {
  Fifo fifo(path_);
  EXPECT_TRUE(fifo.connect({}));
  const UniqueFd reader = read_end();
  {
    const auto killed = fifo.connect({});
    ASSERT_TRUE(killed && killed.value());
    ASSERT_EQ(::write(killed.value().get(), "half", 4), 4);
  }
  const auto early = fifo.connect({});
  ASSERT_TRUE(early);
  EXPECT_FALSE(early.value());
  std::array<char, 8> block{};
  EXPECT_EQ(::read(reader.get(), block.data(), block.size()), 4);
  EXPECT_EQ(::read(reader.get(), block.data(), block.size()), 0);  // the end
  const auto next = fifo.connect({});
  ASSERT_TRUE(next);
  EXPECT_TRUE(next.value());
}

TEST_F(FifoTest, NeverWritesToAnOrdinaryFile) {
  test::write_file(folder_ / "precious", "data");
  const auto end = Fifo(folder_ / "precious").connect({});
  ASSERT_FALSE(end);
  EXPECT_EQ(end.error().text, "open FIFO " + (folder_ / "precious").string() + ": not a FIFO");
  EXPECT_EQ(test::read_file(folder_ / "precious"), "data");
}

TEST_F(FifoTest, SaysWhyItCannotBeMade) {
  test::write_file(folder_ / "robots", "a file where the folder should be");
  const auto end = Fifo(path_).connect({});
  ASSERT_FALSE(end);
  EXPECT_EQ(end.error().text, "make FIFO " + path_.string() + ": Not a directory");
}

}  // namespace
}  // namespace orbbuf
