// SPDX-License-Identifier: Apache-2.0
// The bytes are written out by hand from https://mcap.dev/spec.
#include "server/dataset/mcap/record.hpp"

#include <gtest/gtest.h>

#include <string>

#include "common/crc32.hpp"

namespace orbbuf::mcap {
namespace {

using namespace std::string_literals;

Bytes bytes(const std::string& text) { return {text.begin(), text.end()}; }

/// A record of `opcode` whose fields are these; shorter than 256 bytes.
Bytes record(char opcode, const std::string& fields) {
  return bytes(opcode + std::string(1, static_cast<char>(fields.size())) + "\0\0\0\0\0\0\0"s +
               fields);
}

TEST(McapRecord, AHeaderNamesTheLibrary) {
  Bytes out;
  put_header(out, "", "me 1");
  EXPECT_EQ(out, record('\x01',
                        "\0\0\0\0"
                        "\4\0\0\0me 1"s));
}

TEST(McapRecord, ASchemaCarriesItsData) {
  Bytes out;
  const Bytes data = bytes("xyz");
  put_schema(out, {0x0102, "a.B", "protobuf", data});
  EXPECT_EQ(out, record('\x03',
                        "\2\1"
                        "\3\0\0\0a.B"
                        "\x08\0\0\0protobuf"
                        "\3\0\0\0xyz"s));
}

TEST(McapRecord, AChannelHasNoMetadata) {
  Bytes out;
  put_channel(out, {3, 1, "/r", "json"});
  EXPECT_EQ(out, record('\x04',
                        "\3\0\1\0"
                        "\2\0\0\0/r"
                        "\4\0\0\0json"
                        "\0\0\0\0"s));
}

TEST(McapRecord, AMessageIsLoggedWhenItIsPublished) {
  Bytes out = {9};  // records are appended
  put_message(out, {3, 0x04030201, 0x0807060504030201}, bytes("data"));
  Bytes expected = record('\x05',
                          "\3\0"
                          "\1\2\3\4"
                          "\1\2\3\4\5\6\7\x08"
                          "\1\2\3\4\5\6\7\x08"
                          "data"s);
  expected.insert(expected.begin(), 9);
  EXPECT_EQ(out, expected);
}

TEST(McapRecord, AChunkIsNotCompressed) {
  Bytes out;
  put_chunk(out, {{1, 2}, 7, 0x0A0B0C0D}, bytes("records"));
  EXPECT_EQ(out.size(), kChunkHeadBytes + 7);
  EXPECT_EQ(out, record('\x06',
                        "\1\0\0\0\0\0\0\0"
                        "\2\0\0\0\0\0\0\0"
                        "\7\0\0\0\0\0\0\0"
                        "\x0D\x0C\x0B\x0A"
                        "\0\0\0\0"
                        "\7\0\0\0\0\0\0\0records"s));
}

TEST(McapRecord, AMessageIndexPairsTimesWithOffsets) {
  Bytes out;
  put_message_index(out, 3, std::array{IndexEntry{5, 0}, IndexEntry{6, 300}});
  EXPECT_EQ(out, record('\x07',
                        "\3\0"
                        "\x20\0\0\0"
                        "\5\0\0\0\0\0\0\0"
                        "\0\0\0\0\0\0\0\0"
                        "\6\0\0\0\0\0\0\0"
                        "\x2C\1\0\0\0\0\0\0"s));
}

TEST(McapRecord, AChunkIndexSaysWhereChunkAndMessageIndexesAre) {
  Bytes out;
  put_chunk_index(out, {{{1, 2}, 7, 99}, 100, {{3, 200}}, 31});
  EXPECT_EQ(out, record('\x08',
                        "\1\0\0\0\0\0\0\0"
                        "\2\0\0\0\0\0\0\0"
                        "\x64\0\0\0\0\0\0\0"
                        "\x38\0\0\0\0\0\0\0"  // 49 + 7
                        "\x0A\0\0\0"
                        "\3\0\xC8\0\0\0\0\0\0\0"
                        "\x1F\0\0\0\0\0\0\0"
                        "\0\0\0\0"
                        "\7\0\0\0\0\0\0\0"
                        "\7\0\0\0\0\0\0\0"s));
}

TEST(McapRecord, StatisticsCountMessagesByChannel) {
  Bytes out;
  put_statistics(out, {{1, 2}, 1, 4, 6, {{3, 5}, {7, 2}}});
  EXPECT_EQ(out, record('\x0B',
                        "\7\0\0\0\0\0\0\0"
                        "\1\0"
                        "\2\0\0\0"
                        "\0\0\0\0"
                        "\6\0\0\0"
                        "\4\0\0\0"
                        "\1\0\0\0\0\0\0\0"
                        "\2\0\0\0\0\0\0\0"
                        "\x14\0\0\0"
                        "\3\0\5\0\0\0\0\0\0\0"
                        "\7\0\2\0\0\0\0\0\0\0"s));
}

TEST(McapRecord, MetadataIsAMapWithANameAndItsIndexSaysWhere) {
  Bytes out;
  put_metadata(out, {"clock", "offset", "-5"});
  EXPECT_EQ(out, record('\x0C',
                        "\5\0\0\0clock"
                        "\x10\0\0\0"
                        "\6\0\0\0offset"
                        "\2\0\0\0-5"s));
  Bytes index;
  put_metadata_index(index, 0x0102, 3, "clock");
  EXPECT_EQ(index, record('\x0D',
                          "\2\1\0\0\0\0\0\0"
                          "\3\0\0\0\0\0\0\0"
                          "\5\0\0\0clock"s));
}

TEST(McapRecord, TheEndOfDataAndTheGroupsOfTheSummary) {
  Bytes out;
  put_data_end(out, 0x01020304);
  EXPECT_EQ(out, record('\x0F', "\4\3\2\1"s));
  out.clear();
  put_summary_offset(out, Opcode::kChannel, 5, 6);
  EXPECT_EQ(out, record('\x0E',
                        "\4"
                        "\5\0\0\0\0\0\0\0"
                        "\6\0\0\0\0\0\0\0"s));
}

TEST(McapRecord, TheFootersChecksumIncludesItsOwnBeginning) {
  const Bytes summary = bytes("what was summed up");
  Bytes out;
  put_footer(out, 5, 6, summary);
  Bytes expected = record('\x02',
                          "\5\0\0\0\0\0\0\0"
                          "\6\0\0\0\0\0\0\0"
                          "????"s);
  expected.resize(expected.size() - 4);
  Bytes summed = summary;
  summed.insert(summed.end(), expected.begin(), expected.end());
  const std::uint32_t crc = crc32(summed);
  for (int shift = 0; shift < 32; shift += 8) {
    expected.push_back(static_cast<std::uint8_t>(crc >> shift));
  }
  const Bytes magic = bytes("\x89MCAP0\r\n"s);
  expected.insert(expected.end(), magic.begin(), magic.end());
  EXPECT_EQ(out, expected);
}

}  // namespace
}  // namespace orbbuf::mcap
