// SPDX-License-Identifier: Apache-2.0
#include "daemon/spool/segment.hpp"

#include <gmock/gmock.h>

#include <array>
#include <string>
#include <utility>

#include "tests/daemon/spool/spool_fixture.hpp"
#include "tests/server/resource_limit.hpp"

namespace orbbuf::test {
namespace {

using testing::HasSubstr;

const SegmentHeader kHeader = {"robot", "session", 12};

/// Bytes as hexadecimal digits.
std::string hex(const std::string& bytes) {
  constexpr std::array<char, 17> kDigits = {"0123456789abcdef"};
  std::string text;
  for (const char byte : bytes) {
    const auto value = static_cast<unsigned char>(byte);
    text += kDigits[value >> 4U];
    text += kDigits[value & 15U];
  }
  return text;
}

class SegmentTest : public testing::Test {
 protected:
  SegmentWriter create() {
    std::filesystem::remove(file_);
    auto made = SegmentWriter::create(file_, kHeader);
    if (!made) throw std::runtime_error(made.error().text);
    return std::move(made.value());
  }
  static SegmentRecord append(SegmentWriter& writer, Sequence sequence, std::size_t bytes = 100) {
    auto record = writer.append(*spool_frame(sequence, bytes));
    if (!record) throw std::runtime_error(record.error().text);
    return record.value();
  }
  SegmentReader open() const {
    auto opened = SegmentReader::open(file_);
    if (!opened) throw std::runtime_error(opened.error().text);
    return std::move(opened.value());
  }
  std::string content() const { return read_file(file_); }
  void flip(std::uint64_t offset) const {
    auto bytes = content();
    bytes[offset] = static_cast<char>(bytes[offset] ^ 1);
    write_file(file_, bytes);
  }

  const TemporaryFolder folder_;
  const std::filesystem::path file_ = folder_ / "000000000012.segment";
};

TEST_F(SegmentTest, ItsBytesAreThoseOfTheSpecification) {
  auto writer = create();
  auto frame = std::make_shared<EncodedFrame>(*spool_frame(3, 2));
  frame->jpeg = {0xAB, 0xCD};
  frame->jpeg_crc = wire::crc32(frame->jpeg);
  ASSERT_TRUE(writer.append(*frame));
  ASSERT_FALSE(writer.complete());
  EXPECT_EQ(hex(content()),
            "4f4253500002"
            "0005726f626f74"
            "000773657373696f6e"
            "000000000000000c"
            "633218af"
            "4f425352"
            "00000002"
            "0000000000000003"
            "17979cfe3d510e00"
            "007a1200"
            "0280"
            "01e0"
            "00000001"
            "e9ffc9d0"
            "50"
            "bec9388f"
            "abcd"
            "4f425345"
            "0000000000000001"
            "0000000000000003"
            "0000000000000003"
            "b2c60882");
}

TEST_F(SegmentTest, AnEmptyOneHasAHeaderAndNoRecords) {
  const auto writer = create();
  const auto reader = open();
  EXPECT_EQ(reader.header(), kHeader);
  EXPECT_FALSE(reader.footer());
  EXPECT_TRUE(reader.scan().empty());
  EXPECT_EQ(reader.bytes(), writer.bytes());
}

TEST_F(SegmentTest, FramesComeBackAsTheyWere) {
  auto writer = create();
  std::vector<SegmentRecord> records;
  for (const Sequence sequence : {8U, 2U, 5U})
    records.push_back(append(writer, sequence, 1 + sequence * 1000));
  EXPECT_EQ(open().scan(), records);
  ASSERT_FALSE(writer.complete());
  const auto reader = open();
  EXPECT_EQ(reader.scan(), records);
  EXPECT_EQ(reader.footer(), (FrameRange{3, 2, 8}));
  EXPECT_EQ(reader.bytes(), writer.bytes());
  for (const SegmentRecord& record : records) {
    const auto frame = reader.read(record);
    ASSERT_TRUE(frame);
    EXPECT_TRUE(is_same(*frame.value(), *spool_frame(record.sequence, 1 + record.sequence * 1000)));
  }
}

TEST_F(SegmentTest, ATailTornAtAnyByteCostsTheLastRecordOnly) {
  auto writer = create();
  const std::vector<SegmentRecord> records = {append(writer, 0), append(writer, 1),
                                              append(writer, 2)};
  const auto whole = content();
  for (std::uint64_t length = records[2].offset; length < records[2].end(); ++length) {
    write_file(file_, whole.substr(0, length));
    auto reader = open();
    EXPECT_FALSE(reader.footer());
    const auto found = reader.scan();
    ASSERT_EQ(found, (std::vector<SegmentRecord>{records[0], records[1]})) << length;
    ASSERT_FALSE(reader.complete(found));
    const auto again = open();
    ASSERT_EQ(again.footer(), (FrameRange{2, 0, 1})) << length;
    ASSERT_EQ(again.scan(), found);
    ASSERT_EQ(again.bytes(), records[1].end() + kFooterBytes);
    ASSERT_EQ(reader.bytes(), again.bytes());
  }
}

TEST_F(SegmentTest, ATornFooterIsNone) {
  auto writer = create();
  const auto record = append(writer, 4);
  ASSERT_FALSE(writer.complete());
  const auto whole = content();
  for (std::uint64_t length = record.end(); length < whole.size(); ++length) {
    write_file(file_, whole.substr(0, length));
    ASSERT_FALSE(open().footer()) << length;
    ASSERT_EQ(open().scan(), std::vector<SegmentRecord>{record}) << length;
  }
}

TEST_F(SegmentTest, ATailOfZerosIsNoRecord) {
  auto writer = create();
  const auto record = append(writer, 4);
  write_file(file_, content() + std::string(600'000, '\0'));
  EXPECT_EQ(open().scan(), std::vector<SegmentRecord>{record});
}

TEST_F(SegmentTest, ARecordWithAnyWrongByteIsNotRead) {
  auto writer = create();
  append(writer, 0);
  const auto record = append(writer, 1);
  const auto next = append(writer, 2);
  for (std::uint64_t offset = record.offset; offset < record.end(); ++offset) {
    flip(offset);
    const auto reader = open();
    const auto frame = reader.read(record);
    ASSERT_FALSE(frame) << offset;
    EXPECT_THAT(frame.error().text, HasSubstr("cannot read frame 1 in " + file_.string()));
    EXPECT_TRUE(reader.read(next));
    const std::size_t found = offset < record.offset + kRecordHeadBytes ? 2 : 3;
    ASSERT_EQ(reader.scan().size(), found) << offset;
    ASSERT_EQ(reader.scan().back(), next);
    flip(offset);
  }
}

TEST_F(SegmentTest, ABadBlockOfAnyLengthIsPassedOver) {
  auto writer = create();
  const auto first = append(writer, 0);
  for (Sequence sequence = 1; sequence < 10; ++sequence) append(writer, sequence, 60'000);
  const auto last = append(writer, 10);
  auto bytes = content();
  bytes.replace(first.end(), last.offset - first.end(), last.offset - first.end(), 'R');
  write_file(file_, bytes);
  EXPECT_EQ(open().scan(), (std::vector<SegmentRecord>{first, last}));
}

TEST_F(SegmentTest, RecordsOfAnotherSegmentAreNotTaken) {
  auto writer = create();
  append(writer, 0);
  const auto other = folder_ / "other";
  auto made = SegmentWriter::create(other, {"robot", "session", 13});
  ASSERT_TRUE(made);
  ASSERT_TRUE(made.value().append(*spool_frame(1, 100)));
  const auto bytes = read_file(other);
  write_file(file_, content() + bytes.substr(bytes.size() - kRecordHeadBytes - 100));
  EXPECT_EQ(open().scan().size(), 1U);
}

TEST_F(SegmentTest, AHeaderWithAnyWrongByteOrTooShortIsRefused) {
  const auto writer = create();
  const auto whole = content();
  for (std::uint64_t offset = 0; offset < whole.size(); ++offset) {
    flip(offset);
    ASSERT_FALSE(SegmentReader::open(file_)) << offset;
    write_file(file_, whole.substr(0, offset));
    ASSERT_FALSE(SegmentReader::open(file_)) << offset;
    write_file(file_, whole);
  }
  EXPECT_TRUE(SegmentReader::open(file_));
  EXPECT_FALSE(SegmentReader::open(folder_ / "missing"));
}

TEST_F(SegmentTest, AFileThatExistsIsNotOverwritten) {
  write_file(file_, "something");
  const auto made = SegmentWriter::create(file_, kHeader);
  ASSERT_FALSE(made);
  EXPECT_THAT(made.error().text, HasSubstr(file_.string() + ": File exists"));
  EXPECT_EQ(content(), "something");
}

TEST_F(SegmentTest, AWriteThatFailsLeavesTheFileAsItWas) {
  auto writer = create();
  const auto record = append(writer, 0);
  {
    const ResourceLimit limit(RLIMIT_FSIZE, record.end() + 60);
    EXPECT_FALSE(writer.append(*spool_frame(1, 100)));
    EXPECT_FALSE(writer.is_broken());
    EXPECT_EQ(std::filesystem::file_size(file_), record.end());
  }
  EXPECT_EQ(append(writer, 1).offset, record.end());
  EXPECT_EQ(open().scan().size(), 2U);
}

TEST_F(SegmentTest, AHeaderThatDoesNotFitLeavesNoFile) {
  const ResourceLimit limit(RLIMIT_FSIZE, 10);
  EXPECT_FALSE(SegmentWriter::create(file_, kHeader));
  EXPECT_FALSE(std::filesystem::exists(file_));
}

TEST(FrameRange, CoversWhatIsBetweenItsEnds) {
  FrameRange range;
  EXPECT_FALSE(range.covers(0));
  range.add(7);
  EXPECT_EQ(range, (FrameRange{1, 7, 7}));
  range.add(3);
  EXPECT_TRUE(range.covers(3) && range.covers(5) && range.covers(7));
  EXPECT_FALSE(range.covers(2) || range.covers(8));
  range.add(FrameRange{});
  EXPECT_EQ(range, (FrameRange{2, 3, 7}));
}

}  // namespace
}  // namespace orbbuf::test
