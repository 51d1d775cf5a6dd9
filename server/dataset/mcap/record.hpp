// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

/// The bytes of an MCAP file's records, as https://mcap.dev/spec has them: an opcode, a length of
/// eight bytes, the fields, all little-endian. What we write, nothing more.
/// Each put_...() appends one whole record.
namespace orbbuf::mcap {

using Bytes = std::vector<std::uint8_t>;

/// At the beginning of a file and at its end.
inline constexpr std::string_view kMagic = "\x89MCAP0\r\n";

enum class Opcode : std::uint8_t {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kStatistics = 0x0B,
  kMetadata = 0x0C,
  kMetadataIndex = 0x0D,
  kSummaryOffset = 0x0E,
  kDataEnd = 0x0F,
};

/// Of a chunk record without compression, up to the records in it.
inline constexpr std::size_t kChunkHeadBytes = 49;

struct Schema {
  std::uint16_t id = 0;
  std::string_view name;
  std::string_view encoding;
  std::span<const std::uint8_t> data;
};

struct Channel {
  std::uint16_t id = 0;
  std::uint16_t schema_id = 0;
  std::string_view topic;
  std::string_view message_encoding;
};

/// All of a message record but its data. It is recorded under the time at which it was published.
struct MessageHead {
  std::uint16_t channel_id = 0;
  std::uint32_t sequence = 0;
  std::uint64_t time_ns = 0;
};

/// From the earliest to the latest message; both 0 if there is none.
struct TimeSpan {
  std::uint64_t first_ns = 0;
  std::uint64_t last_ns = 0;
};

/// One entry, by which a reader of any program finds it.
struct Metadata {
  std::string_view name;
  std::string_view key;
  std::string_view value;
};

struct ChunkHead {
  TimeSpan time;
  std::uint64_t records_bytes = 0;
  std::uint32_t records_crc = 0;
};

struct IndexEntry {
  std::uint64_t time_ns = 0;
  std::uint64_t offset = 0;  ///< of the message record, from the chunk's first record

  friend bool operator==(const IndexEntry&, const IndexEntry&) = default;
};

struct ChunkIndex {
  ChunkHead chunk;
  std::uint64_t offset = 0;  ///< of the chunk record in the file
  std::vector<std::pair<std::uint16_t, std::uint64_t>> index_offsets;  ///< by channel, in the file
  std::uint64_t index_bytes = 0;
};

struct Statistics {
  TimeSpan time;
  std::uint16_t schemas = 0;
  std::uint32_t chunks = 0;
  std::uint32_t metadata = 0;
  std::map<std::uint16_t, std::uint64_t> messages;  ///< by channel
};

void put_header(Bytes& out, std::string_view profile, std::string_view library);
void put_schema(Bytes& out, const Schema& schema);
void put_channel(Bytes& out, const Channel& channel);
void put_message(Bytes& out, const MessageHead& head, std::span<const std::uint8_t> data);
void put_chunk(Bytes& out, const ChunkHead& head, std::span<const std::uint8_t> records);
void put_message_index(Bytes& out, std::uint16_t channel_id, std::span<const IndexEntry> entries);
void put_chunk_index(Bytes& out, const ChunkIndex& index);
void put_statistics(Bytes& out, const Statistics& statistics);
void put_metadata(Bytes& out, const Metadata& metadata);
/// offset, bytes: of the whole metadata record in the file.
void put_metadata_index(Bytes& out, std::uint64_t offset, std::uint64_t bytes,
                        std::string_view name);
void put_summary_offset(Bytes& out, Opcode group, std::uint64_t start, std::uint64_t bytes);
void put_data_end(Bytes& out, std::uint32_t data_crc);
/// And the magic behind it. summary: what stands in the file before the footer, from
/// `summary_start` on; the summary offsets in it begin at `offsets_start`.
void put_footer(Bytes& out, std::uint64_t summary_start, std::uint64_t offsets_start,
                std::span<const std::uint8_t> summary);

}  // namespace orbbuf::mcap
