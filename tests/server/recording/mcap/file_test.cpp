// SPDX-License-Identifier: Apache-2.0
// With mcap_scan.cpp, by which a file is taken up again. That others read the files, too, is for
// tests/e2e/mcap.sh.
#include "server/recording/mcap/file.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <string>
#include <vector>

#include "common/as_bytes.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf::mcap {
namespace {

constexpr std::uint64_t kSecond = 1'000'000'000;

class McapFileTest : public testing::Test {
 protected:
  static bool none(const MessageHead& /*head*/) { return false; }

  File file() const { return {path_, "test 1"}; }

  /// Two messages on two channels, which belong together.
  static Batch pair(std::uint32_t sequence, std::uint64_t time_ns, std::size_t bytes = 100) {
    const std::string data(bytes, static_cast<char>('a' + sequence % 26));
    Batch batch;
    if (sequence == 0) {
      batch.add(Schema{1, "s", "jsonschema", as_bytes("{}")});
      batch.add(Channel{1, 1, "/left", "json"});
      batch.add(Channel{2, 1, "/right", "json"});
    }
    batch.add({1, sequence, time_ns}, as_bytes(data));
    batch.add({2, sequence, time_ns + 1}, as_bytes(data));
    return batch;
  }

  Contents scanned() const {
    const auto contents = scan(path_, "test", none);
    EXPECT_TRUE(contents) << contents.error().text;
    return contents ? contents.value() : Contents{};
  }

  /// How many pairs there are; checks that none is half.
  static std::size_t pairs(const Contents& contents) {
    std::map<std::uint16_t, std::uint64_t> counts = contents.closed.messages;
    for (const auto& [message, offset] : contents.open) ++counts[message.channel_id];
    EXPECT_EQ(counts[1], counts[2]);
    if (counts[1] > 0) {
      EXPECT_EQ(contents.highest.at(2) + 1, counts[2]);
    }
    return counts[1];
  }

  std::string content() const { return test::read_file(path_); }

  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_ / "r/s.mcap";
};

TEST_F(McapFileTest, NothingIsMadeBeforeTheFirstBatch) {
  auto out = file();
  EXPECT_FALSE(out.recover(none));
  EXPECT_FALSE(out.finish({}));
  EXPECT_FALSE(std::filesystem::exists(path_.parent_path()));
}

TEST_F(McapFileTest, AChunkHoldsASecond) {
  auto out = file();
  for (std::uint32_t i = 0; i < 25; ++i) EXPECT_FALSE(out.append(pair(i, i * kSecond / 10)));
  EXPECT_EQ(out.contents().closed.chunks, 2U);
  EXPECT_EQ(out.contents().open.size(), 10U);
  EXPECT_EQ(out.contents().closed.time.last_ns, 19 * kSecond / 10 + 1);
}

TEST_F(McapFileTest, AChunkHoldsAMegabyteOrOneBatchThatIsLarger) {
  auto out = file();
  for (std::uint32_t i = 0; i < 4; ++i) EXPECT_FALSE(out.append(pair(i, i, 200'000)));
  EXPECT_EQ(out.contents().closed.chunks, 1U);
  EXPECT_FALSE(out.append(pair(4, 4, 2'000'000)));
  EXPECT_FALSE(out.append(pair(5, 5, 1)));
  EXPECT_EQ(out.contents().closed.chunks, 3U);
}

TEST_F(McapFileTest, ChunksGrowSoThatTheirIndexStaysSmall) {
  auto out = file();
  std::uint32_t i = 0;
  for (; out.contents().chunk_indexes.size() < (2U << 20); ++i) {
    ASSERT_FALSE(out.append(pair(i, i * kSecond, 1)));
  }
  const auto chunks = out.contents().closed.chunks;
  EXPECT_EQ(chunks + 1, i);
  for (std::uint32_t more = 0; more < 8; ++more, ++i) {
    EXPECT_FALSE(out.append(pair(i, i * kSecond, 1)));
  }
  EXPECT_EQ(out.contents().closed.chunks, chunks + 4);
  EXPECT_EQ(scanned().chunk_indexes, out.contents().chunk_indexes);
}

TEST_F(McapFileTest, WhatWasRecoveredIsWhatWasWritten) {
  auto out = file();
  for (std::uint32_t i = 0; i < 25; ++i) {
    EXPECT_FALSE(out.append(pair(i, i * kSecond / 10)));
    const Contents found = scanned();
    const Contents& written = out.contents();
    EXPECT_EQ(found.chunk_offset, written.chunk_offset);
    EXPECT_EQ(found.crc, written.crc);
    EXPECT_EQ(found.chunk_indexes, written.chunk_indexes);
    EXPECT_EQ(found.closed.messages, written.closed.messages);
    EXPECT_EQ(found.chunk.records_crc, written.chunk.records_crc);
    EXPECT_EQ(found.end(), written.end());
    EXPECT_EQ(found.highest, written.highest);
  }
}

TEST_F(McapFileTest, WhateverAKillLeavesWholeBatchesAreKept) {
  auto out = file();
  for (std::uint32_t i = 0; i < 3; ++i) EXPECT_FALSE(out.append(pair(i, i * kSecond / 2, 1)));
  EXPECT_FALSE(out.finish({}));
  const std::string whole = content();
  std::size_t before = 0;
  for (std::size_t size = 0; size < whole.size(); ++size) {
    test::write_file(path_, whole.substr(0, size));
    const std::size_t found = pairs(scanned());
    EXPECT_GE(found, before);
    before = found;
    auto again = file();
    ASSERT_FALSE(again.recover(none));
    ASSERT_FALSE(again.append(pair(static_cast<std::uint32_t>(found), found * kSecond / 2, 1)));
    ASSERT_EQ(pairs(scanned()), found + 1) << size;
  }
  EXPECT_EQ(before, 3U);
}

TEST_F(McapFileTest, AKillBetweenABatchAndTheHeadThatTakesItInLosesTheBatch) {
  auto out = file();
  EXPECT_FALSE(out.append(pair(0, 0)));
  EXPECT_FALSE(out.append(pair(1, 1)));
  const std::string before = content();
  EXPECT_FALSE(out.append(pair(2, 2)));
  test::write_file(path_, before + content().substr(before.size()));
  EXPECT_EQ(pairs(scanned()), 2U);
}

TEST_F(McapFileTest, NumbersThatGoBackBeginAChunk) {
  auto out = file();
  for (const std::uint32_t i : {0U, 8U, 9U}) EXPECT_FALSE(out.append(pair(i, i * kSecond / 25)));
  EXPECT_EQ(out.contents().closed.chunks, 0U);
  for (const std::uint32_t i : {3U, 4U, 4U}) EXPECT_FALSE(out.append(pair(i, i * kSecond / 25)));
  EXPECT_EQ(out.contents().closed.chunks, 2U);
  EXPECT_EQ(out.contents().highest.at(1), 9U);
  EXPECT_EQ(scanned().highest, out.contents().highest);
  for (const std::uint32_t i : {5U, 20U}) EXPECT_FALSE(out.append(pair(i, i * kSecond / 25)));
  EXPECT_EQ(out.contents().closed.chunks, 2U);
  EXPECT_EQ(scanned().highest.at(1), 20U);
}

TEST_F(McapFileTest, FindsMessagesByTheirTimes) {
  auto out = file();
  const auto found = [&](const std::set<std::uint64_t>& times_ns) {
    std::vector<std::uint32_t> numbers;
    const auto messages = messages_at(path_, scanned(), times_ns);
    EXPECT_TRUE(messages);
    for (const MessageHead& message : messages.value()) {
      EXPECT_TRUE(times_ns.contains(message.time_ns));
      if (message.channel_id == 1) numbers.push_back(message.sequence);
    }
    std::sort(numbers.begin(), numbers.end());
    return numbers;
  };
  EXPECT_TRUE(found({0}).empty());
  for (std::uint32_t i = 0; i < 35; ++i) EXPECT_FALSE(out.append(pair(i, i * kSecond / 10)));
  ASSERT_EQ(out.contents().closed.chunks, 3U);
  using Numbers = std::vector<std::uint32_t>;
  EXPECT_EQ(found({0, 13 * kSecond / 10, 13 * kSecond / 10 + 2, 34 * kSecond / 10}),
            (Numbers{0, 13, 34}));
  EXPECT_EQ(found({9 * kSecond / 10, 10 * kSecond / 10}), (Numbers{9, 10}));
  EXPECT_TRUE(found({}).empty());
  EXPECT_FALSE(out.append(pair(13, 13 * kSecond / 10)));
  EXPECT_FALSE(out.finish({}));
  EXPECT_EQ(found({13 * kSecond / 10}), (Numbers{13, 13}));
}

TEST_F(McapFileTest, AFinishedFileGoesOn) {
  auto out = file();
  for (std::uint32_t i = 0; i < 5; ++i) EXPECT_FALSE(out.append(pair(i, i * kSecond / 2)));
  EXPECT_FALSE(out.finish({}));
  const std::string finished = content();
  auto again = file();
  EXPECT_FALSE(again.recover(none));
  EXPECT_FALSE(again.finish({}));
  EXPECT_EQ(content(), finished);
  EXPECT_FALSE(again.append(pair(5, 5 * kSecond / 2)));
  EXPECT_EQ(pairs(scanned()), 6U);
  EXPECT_FALSE(out.contents().closed.chunks == 0);
}

TEST_F(McapFileTest, LeavesOutWhatIsBeyondAndItsTrailIsWritable) {
  auto out = file();
  for (std::uint32_t i = 0; i < 3; ++i) EXPECT_FALSE(out.append(pair(i, i)));
  auto again = file();
  EXPECT_FALSE(again.recover([](const MessageHead& head) { return head.sequence >= 2; }));
  EXPECT_EQ(pairs(again.contents()), 2U);
  EXPECT_FALSE(again.append(pair(2, 7)));
  EXPECT_EQ(pairs(scanned()), 3U);
  EXPECT_EQ(scanned().chunk.records_crc, again.contents().chunk.records_crc);
}

TEST_F(McapFileTest, WhatIsBeyondInChunksBeforeIsNoLeftover) {
  auto out = file();
  for (std::uint32_t i = 0; i < 3; ++i) EXPECT_FALSE(out.append(pair(i, i * kSecond)));
  auto again = file();
  EXPECT_FALSE(again.recover([](const MessageHead& head) { return head.sequence >= 1; }));
  EXPECT_EQ(pairs(again.contents()), 3U);
}

TEST_F(McapFileTest, OnAFullDiskNothingOfTheBatchRemains) {
  auto out = file();
  EXPECT_FALSE(out.append(pair(0, 0)));
  const std::string before = content();
  for (const std::uint64_t time_ns : {1 * kSecond / 2, 2 * kSecond}) {  // the chunk's, a new one's
    {
      const test::ResourceLimit full(RLIMIT_FSIZE, before.size() + 1000);
      const auto error = out.append(pair(1, time_ns, 5000));
      ASSERT_TRUE(error);
      EXPECT_NE(error->text.find("s.mcap: File too large"), std::string::npos) << error->text;
    }
    EXPECT_EQ(pairs(scanned()), 1U);
    EXPECT_EQ(std::filesystem::file_size(path_), out.contents().end());
  }
  EXPECT_FALSE(out.append(pair(1, 2 * kSecond, 5000)));
  EXPECT_EQ(pairs(scanned()), 2U);
}

TEST_F(McapFileTest, ASummaryThatDoesNotFitCostsNothingElse) {
  auto out = file();
  EXPECT_FALSE(out.append(pair(0, 0)));
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, content().size() + 100);
    EXPECT_TRUE(out.finish({}));
  }
  EXPECT_EQ(pairs(scanned()), 1U);
  EXPECT_FALSE(out.finish({}));
  EXPECT_TRUE(content().ends_with(kMagic));
}

TEST_F(McapFileTest, AFileThatSomebodyRemovedBeginsAnewWithTheNextTry) {
  auto out = file();
  EXPECT_FALSE(out.append(pair(0, 0)));
  std::filesystem::remove_all(path_.parent_path());
  const auto error = out.append(pair(1, 1));
  ASSERT_TRUE(error);
  EXPECT_NE(error->text.find("another program removed or truncated it"), std::string::npos);
  EXPECT_TRUE(out.contents().highest.empty());
  EXPECT_FALSE(out.append(pair(0, 1)));
  EXPECT_EQ(pairs(scanned()), 1U);
}

TEST_F(McapFileTest, AFileOfSomebodyElseIsAnErrorAndLeftAlone) {
  std::filesystem::create_directory(path_.parent_path());
  Bytes other(kMagic.begin(), kMagic.end());
  put_header(other, "rosbag2");
  for (const std::string& text :
       {std::string("my notes"), std::string(other.begin(), other.end())}) {
    test::write_file(path_, text);
    const auto error = file().recover(none);
    ASSERT_TRUE(error) << text;
    EXPECT_NE(error->text.find("not a recording by test"), std::string::npos);
    EXPECT_EQ(content(), text);
  }
}

TEST_F(McapFileTest, AFileThatCannotBeReadIsAnError) {
  std::filesystem::create_directories(path_);
  EXPECT_TRUE(file().recover(none));
}

TEST_F(McapFileTest, GarbageIsReadToItsEndAndNoFurther) {
  auto out = file();
  for (std::uint32_t i = 0; i < 4; ++i) EXPECT_FALSE(out.append(pair(i, i * kSecond / 2, 20)));
  EXPECT_FALSE(out.finish({}));
  const std::string whole = content();
  constexpr std::size_t kStep = 13;
  for (std::size_t at = kMagic.size(); at < whole.size(); at += kStep) {
    for (const char garbage : {'\0', '\x7F', '\xFF'}) {
      std::string damaged = whole;
      damaged[at] = garbage;
      test::write_file(path_, damaged);
      const auto contents = scan(path_, "test", none);
      if (contents) {
        EXPECT_LE(contents.value().end(), whole.size());
      }
    }
  }
}

}  // namespace
}  // namespace orbbuf::mcap
