// SPDX-License-Identifier: Apache-2.0
// That others read the files, too, is for tests/e2e/mcap.sh.
#include "server/dataset/mcap/file.hpp"

#include <gmock/gmock.h>

#include <string>

#include "common/as_bytes.hpp"
#include "tests/server/dataset/mcap/contents.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf::mcap {
namespace {

using testing::ElementsAre;
using testing::Pair;

class McapFileTest : public testing::Test {
 protected:
  File create() const {
    auto file = File::create(path_, "", "test 1");
    EXPECT_TRUE(file) << file.error().text;
    file.value().add(Schema{1, "s", "jsonschema", as_bytes("{}")});
    file.value().add(Channel{1, 1, "/a", "json"});
    return std::move(file).value();
  }
  static bool add(File& file, std::uint32_t sequence, std::uint64_t time_ns, std::size_t bytes) {
    const auto added = file.add({1, sequence, time_ns}, as_bytes(std::string(bytes, 'x')));
    EXPECT_TRUE(added);
    return added && added.value();
  }

  test::TemporaryFolder folder_;
  std::filesystem::path path_ = folder_ / "s.mcap";
};

TEST_F(McapFileTest, HasItsMessagesInChunksOfAMegabyteAndASummary) {
  File file = create();
  EXPECT_FALSE(add(file, 0, 70, 500'000));
  EXPECT_FALSE(add(file, 1, 50, 500'000));
  EXPECT_TRUE(add(file, 2, 60, 500'000));
  EXPECT_FALSE(add(file, 3, 10, 1));
  EXPECT_FALSE(file.finish(std::nullopt));
  const auto found = test::read_mcap(path_);
  EXPECT_THAT(found.of("/a"), ElementsAre(0, 1, 2, 3));
  EXPECT_THAT(found.chunk_times, ElementsAre(Pair(50, 70), Pair(10, 10)));
  auto records = found.records;
  EXPECT_EQ(records[0x03], 2);  // in the first chunk, and in the summary
  EXPECT_EQ(records[0x04], 2);
  EXPECT_EQ(records[0x07], 2);  // message indexes
  EXPECT_EQ(records[0x08], 2);  // chunk indexes
  EXPECT_EQ(records[0x0B], 1);  // statistics
  EXPECT_EQ(records[0x0C], 0);  // metadata
  EXPECT_EQ(records[0x0F], 1);  // end of the data
}

TEST_F(McapFileTest, AMessageLargerThanAChunkIsOne) {
  File file = create();
  EXPECT_TRUE(add(file, 0, 1, 3 * File::kChunkBytes));
  EXPECT_FALSE(file.finish(std::nullopt));
  EXPECT_THAT(test::read_mcap(path_).chunk_times, ElementsAre(Pair(1, 1)));
}

TEST_F(McapFileTest, MetadataStandsInItAndInItsIndex) {
  File file = create();
  add(file, 0, 1, 1);
  EXPECT_FALSE(file.finish(Metadata{"clock", "offset", "5"}));
  auto records = test::read_mcap(path_).records;
  EXPECT_EQ(records[0x0C], 1);
  EXPECT_EQ(records[0x0D], 1);
}

TEST_F(McapFileTest, ReplacesWhatAnEarlierTryHasLeft) {
  test::write_file(path_, std::string(5'000'000, 'x'));
  File file = create();
  add(file, 0, 1, 1);
  EXPECT_FALSE(file.finish(std::nullopt));
  EXPECT_THAT(test::read_mcap(path_).of("/a"), ElementsAre(0));
}

TEST_F(McapFileTest, AFullDiskIsAnError) {
  File file = create();
  const test::ResourceLimit full(RLIMIT_FSIZE, 100'000);
  const auto added = file.add({1, 0, 0}, as_bytes(std::string(2'000'000, 'x')));
  ASSERT_FALSE(added);
  EXPECT_NE(added.error().text.find("s.mcap: File too large"), std::string::npos);
}

TEST_F(McapFileTest, AFolderThatIsNotThereIsAnError) {
  EXPECT_FALSE(File::create(folder_ / "none/s.mcap", "", "test 1"));
}

}  // namespace
}  // namespace orbbuf::mcap
