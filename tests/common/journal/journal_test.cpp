// SPDX-License-Identifier: Apache-2.0
#include "common/journal/journal.hpp"

#include <gmock/gmock.h>

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "common/as_bytes.hpp"
#include "testing/temporary_folder.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf::journal {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

constexpr std::uint8_t kText = 7;

class Journal : public testing::Test {
 protected:
  Writer writer(std::uint64_t segment_bytes = 1U << 20, bool is_synced = false) {
    return {folder_.path(), segment_bytes, is_synced, [this] {
              const auto bytes = as_bytes(state_);
              return std::vector<std::uint8_t>(bytes.begin(), bytes.end());
            }};
  }
  static Place append(Writer& writer, const std::string& text) {
    const auto place = writer.append(kText, {as_bytes(text)});
    EXPECT_TRUE(place) << (place ? "" : place.error().text);
    return place.value();
  }
  /// What next() returns, checkpoints as `[state]`.
  static std::vector<std::string> rest_of(Reader& reader) {
    std::vector<std::string> texts;
    for (;;) {
      const auto record = reader.next();
      EXPECT_TRUE(record) << (record ? "" : record.error().text);
      if (!record || !record.value()) return texts;
      const auto& [type, place, end, body] = *record.value();
      std::string text(body.begin(), body.end());
      texts.push_back(type == kCheckpoint ? "[" + text + "]" : std::move(text));
    }
  }
  std::vector<std::string> all() const {
    Reader reader(folder_.path());
    return rest_of(reader);
  }
  std::filesystem::path file(std::uint32_t segment = 0) const {
    return segment_path(folder_.path(), segment);
  }

  const test::TemporaryFolder folder_;
  std::string state_ = "new";
};

TEST_F(Journal, OfNothingHasNoRecords) {
  EXPECT_THAT(all(), IsEmpty());
  EXPECT_THAT(segments_in(folder_ / "missing").value(), IsEmpty());
}

TEST_F(Journal, BeginsWithACheckpointAndReturnsWhatWasAppended) {
  Writer out = writer();
  append(out, "one");
  append(out, "");
  append(out, std::string(Reader::kBlockBytes * 2, 'x'));
  EXPECT_THAT(all(), ElementsAre("[new]", "one", "", std::string(Reader::kBlockBytes * 2, 'x')));
}

TEST_F(Journal, JoinsThePartsOfABody) {
  Writer out = writer();
  ASSERT_TRUE(out.append(kText, {as_bytes("a"), as_bytes(""), as_bytes("bc")}));
  EXPECT_THAT(all(), ElementsAre("[new]", "abc"));
}

TEST_F(Journal, BeginsASegmentWithTheStateWhenTheLastIsFull) {
  Writer out = writer(60);
  append(out, "one");  // 16 + 16 bytes, checkpoint and record
  append(out, std::string(20, '2'));
  state_ = "two before";
  append(out, "three");
  EXPECT_THAT(segments_in(folder_.path()).value(), ElementsAre(0, 1));
  EXPECT_THAT(all(), ElementsAre("[new]", "one", std::string(20, '2'), "[two before]", "three"));
  Reader newest(folder_.path(), {1, 0});
  EXPECT_THAT(rest_of(newest), ElementsAre("[two before]", "three"));
}

TEST_F(Journal, IsReadFromThePlaceOfARecordOn) {
  Writer out = writer();
  append(out, "one");
  const Place place = append(out, "two");
  append(out, "three");
  Reader reader(folder_.path(), place);
  EXPECT_THAT(rest_of(reader), ElementsAre("two", "three"));
}

TEST_F(Journal, IsReadWhileItGrowsIntoNewSegments) {
  Writer out = writer(40);
  Reader reader(folder_.path());
  EXPECT_THAT(rest_of(reader), IsEmpty());
  append(out, "one");
  EXPECT_THAT(rest_of(reader), ElementsAre("[new]", "one"));
  append(out, "two");
  append(out, "three");
  EXPECT_THAT(rest_of(reader), ElementsAre("two", "[new]", "three"));
  EXPECT_EQ(reader.place(), out.end());
}

TEST_F(Journal, GoesOnBehindItsLastRecord) {
  {
    Writer out = writer();
    append(out, "one");
  }
  Reader reader(folder_.path());
  rest_of(reader);
  Writer out = writer();
  ASSERT_FALSE(out.open(reader.place()));
  append(out, "two");
  EXPECT_THAT(all(), ElementsAre("[new]", "one", "two"));
}

TEST_F(Journal, OpenCutsWhatIsBehindAPlace) {
  Place place;
  {
    Writer out = writer(40);
    append(out, "one");
    place = append(out, "two");
    append(out, "three");
    append(out, "four");
  }
  ASSERT_FALSE(writer().open(place));
  EXPECT_THAT(all(), ElementsAre("[new]", "one"));
}

TEST_F(Journal, LeavesOutARemovedSegment) {
  Writer out = writer(20);
  append(out, "one");
  append(out, "two");
  append(out, "three");
  ASSERT_FALSE(out.remove(0));
  EXPECT_THAT(all(), ElementsAre("[new]", "two", "[new]", "three"));
}

/// Whatever a kill leaves of the last record, those before it are there, and the next one follows.
TEST_F(Journal, ATornRecordAtTheEndIsNone) {
  std::uint64_t bytes = 0;
  {
    Writer out = writer();
    append(out, "one");
    bytes = out.end().offset;
    append(out, "two");
  }
  const auto whole = std::filesystem::file_size(file());
  for (auto size = whole - 1; size >= bytes; --size) {
    std::filesystem::resize_file(file(), size);
    Reader reader(folder_.path());
    EXPECT_THAT(rest_of(reader), ElementsAre("[new]", "one")) << size;
    EXPECT_EQ(reader.place(), (Place{0, bytes}));
    EXPECT_EQ(reader.damaged_bytes(), 0U);
  }
  Writer out = writer();
  ASSERT_FALSE(out.open({0, bytes}));
  append(out, "three");
  EXPECT_THAT(all(), ElementsAre("[new]", "one", "three"));
}

TEST_F(Journal, ZerosThatAPowerCutLeavesAtTheEndAreNoRecord) {
  Writer out = writer();
  append(out, "one");
  const auto bytes = std::filesystem::file_size(file());
  std::filesystem::resize_file(file(), bytes + 5000);
  Reader reader(folder_.path());
  EXPECT_THAT(rest_of(reader), ElementsAre("[new]", "one"));
  EXPECT_EQ(reader.place().offset, bytes);
}

/// A bad byte anywhere costs the record that it is in, and no other.
TEST_F(Journal, ADamagedByteCostsOneRecordOnly) {
  Writer out = writer();
  const Place one = append(out, "one");
  const Place two = append(out, "two");
  append(out, "three");
  const std::string good = test::read_file(file());
  const std::vector<std::string> texts = {"[new]", "one", "two", "three"};
  for (std::size_t i = 0; i < two.offset + 16; ++i) {
    std::string bad = good;
    bad[i] = static_cast<char>(bad[i] ^ 0x20);
    test::write_file(file(), bad);
    const std::size_t hit = i < one.offset ? 0 : i < two.offset ? 1 : 2;
    auto expected = texts;
    expected.erase(expected.begin() + static_cast<std::ptrdiff_t>(hit));
    Reader reader(folder_.path());
    EXPECT_EQ(rest_of(reader), expected) << "byte " << i;
    EXPECT_EQ(reader.damaged_bytes(), 16U);
  }
}

TEST_F(Journal, AWriterThatCannotBeOpenedOverwritesNothing) {
  Writer first = writer();
  append(first, "one");
  std::filesystem::create_directory(file(1));  // cannot be removed as a segment
  Writer next = writer();
  EXPECT_TRUE(next.open(first.end()));
  EXPECT_FALSE(next.append(kText, {as_bytes("two")}));
  std::filesystem::remove(file(1));
  append(next, "three");
  EXPECT_THAT(all(), ElementsAre("[new]", "one", "[new]", "three"));
}

TEST_F(Journal, DamageAtTheEndOfASegmentThatIsNotTheLastIsCounted) {
  Writer out = writer(20);
  append(out, "one");
  append(out, "two");
  std::filesystem::resize_file(file(0), std::filesystem::file_size(file(0)) - 1);
  Reader reader(folder_.path());
  EXPECT_THAT(rest_of(reader), ElementsAre("[new]", "[new]", "two"));
  EXPECT_EQ(reader.damaged_bytes(), 15U);
}

TEST_F(Journal, ARecordWithinTheBodyOfADamagedOneIsFound) {
  Writer out = writer();
  append(out, "inner");
  const std::string inner = test::read_file(file()).substr(16);
  append(out, "outer " + inner);
  std::string bad = test::read_file(file());
  bad[16 + inner.size() + 14] ^= 1;  // in the outer one's body, before the inner
  test::write_file(file(), bad);
  EXPECT_THAT(all(), ElementsAre("[new]", "inner", "inner"));
}

TEST_F(Journal, AfterAFullDiskGoesOnWhereItWas) {
  Writer out = writer();
  append(out, "one");
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, 40);
    const auto failed = out.append(kText, {as_bytes(std::string(100, 'x'))});
    ASSERT_FALSE(failed);
    EXPECT_THAT(failed.error().text, testing::HasSubstr("File too large"));
  }
  EXPECT_THAT(all(), ElementsAre("[new]", "one"));
  append(out, "two");
  EXPECT_THAT(all(), ElementsAre("[new]", "one", "two"));
}

TEST_F(Journal, OnAFullDiskLeavesNoPieceOfANewSegment) {
  Writer out = writer(20);
  append(out, "one");
  state_ = std::string(100, 's');
  {
    const test::ResourceLimit full(RLIMIT_FSIZE, 40);
    EXPECT_FALSE(out.append(kText, {as_bytes("two")}));
  }
  EXPECT_THAT(segments_in(folder_.path()).value(), ElementsAre(0));
  state_ = "two";
  append(out, "two");
  EXPECT_THAT(all(), ElementsAre("[new]", "one", "[two]", "two"));
}

TEST_F(Journal, NoticesThatItsFileWasRemoved) {
  Writer out = writer();
  EXPECT_TRUE(out.is_there());
  append(out, "one");
  EXPECT_TRUE(out.is_there());
  std::filesystem::remove(file());
  EXPECT_FALSE(out.is_there());
}

TEST_F(Journal, NoticesThatItsFolderWasMoved) {
  const test::TemporaryFolder parent;
  const auto folder = parent / "session";
  std::filesystem::create_directory(folder);
  Writer out(folder, 1U << 20, false, [] { return std::vector<std::uint8_t>(); });
  append(out, "one");
  std::filesystem::rename(folder, parent / "moved");
  EXPECT_FALSE(out.is_there());
  std::filesystem::copy(parent / "moved", folder);
  EXPECT_FALSE(out.is_there());
}

TEST_F(Journal, SyncsAllSegments) {
  Writer out = writer(20, true);
  EXPECT_FALSE(out.sync());  // of nothing
  append(out, "one");
  append(out, "two");
  EXPECT_FALSE(out.sync());
  EXPECT_FALSE(out.sync());
}

}  // namespace
}  // namespace orbbuf::journal
