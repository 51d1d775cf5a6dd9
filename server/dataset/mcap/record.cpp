// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/mcap/record.hpp"

#include <concepts>

#include "common/crc32.hpp"

namespace orbbuf::mcap {
namespace {

template <std::unsigned_integral T>
void put(Bytes& out, T value) {
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    out.push_back(static_cast<std::uint8_t>(std::uint64_t{value} >> (8 * i)));
  }
}

void put(Bytes& out, std::span<const std::uint8_t> bytes) {
  out.insert(out.end(), bytes.begin(), bytes.end());
}

void put(Bytes& out, std::string_view text) {
  put(out, static_cast<std::uint32_t>(text.size()));
  out.insert(out.end(), text.begin(), text.end());
}

void put(Bytes& out, const TimeSpan& time) {
  put(out, time.first_ns);
  put(out, time.last_ns);
}

template <class T>
concept Map = requires(const T& map) {
  map.begin()->second;
};

/// Of which each entry takes kEntryBytes.
template <Map M>
void put(Bytes& out, const M& map) {
  constexpr std::size_t kEntryBytes = 10;
  put(out, static_cast<std::uint32_t>(map.size() * kEntryBytes));
  for (const auto& [key, value] : map) {
    put(out, key);
    put(out, value);
  }
}

template <class... Fields>
void put_record(Bytes& out, Opcode opcode, const Fields&... fields) {
  out.push_back(static_cast<std::uint8_t>(opcode));
  const std::size_t length_at = out.size();
  put(out, std::uint64_t{0});
  const std::size_t begin = out.size();
  (put(out, fields), ...);
  const std::uint64_t length = out.size() - begin;
  for (std::size_t i = 0; i < sizeof length; ++i) {
    out[length_at + i] = static_cast<std::uint8_t>(length >> (8 * i));
  }
}

constexpr std::string_view kNoCompression;

}  // namespace

void put_header(Bytes& out, std::string_view profile, std::string_view library) {
  put_record(out, Opcode::kHeader, profile, library);
}

void put_schema(Bytes& out, const Schema& schema) {
  put_record(out, Opcode::kSchema, schema.id, schema.name, schema.encoding,
             static_cast<std::uint32_t>(schema.data.size()), schema.data);
}

void put_channel(Bytes& out, const Channel& channel) {
  constexpr std::uint32_t kMetadataBytes = 0;
  put_record(out, Opcode::kChannel, channel.id, channel.schema_id, channel.topic,
             channel.message_encoding, kMetadataBytes);
}

void put_message(Bytes& out, const MessageHead& head, std::span<const std::uint8_t> data) {
  put_record(out, Opcode::kMessage, head.channel_id, head.sequence, head.time_ns, head.time_ns,
             data);
}

void put_chunk(Bytes& out, const ChunkHead& head, std::span<const std::uint8_t> records) {
  put_record(out, Opcode::kChunk, head.time, head.records_bytes, head.records_crc, kNoCompression,
             head.records_bytes, records);
}

void put_message_index(Bytes& out, std::uint16_t channel_id, std::span<const IndexEntry> entries) {
  Bytes index;
  for (const IndexEntry& entry : entries) {
    put(index, entry.time_ns);
    put(index, entry.offset);
  }
  put_record(out, Opcode::kMessageIndex, channel_id, static_cast<std::uint32_t>(index.size()),
             index);
}

void put_chunk_index(Bytes& out, const ChunkIndex& index) {
  put_record(out, Opcode::kChunkIndex, index.chunk.time, index.offset,
             kChunkHeadBytes + index.chunk.records_bytes, index.index_offsets, index.index_bytes,
             kNoCompression, index.chunk.records_bytes, index.chunk.records_bytes);
}

void put_statistics(Bytes& out, const Statistics& statistics) {
  constexpr std::uint32_t kAttachments = 0;
  std::uint64_t messages = 0;
  for (const auto& [channel, count] : statistics.messages) messages += count;
  put_record(out, Opcode::kStatistics, messages, statistics.schemas,
             static_cast<std::uint32_t>(statistics.messages.size()), kAttachments,
             statistics.metadata, statistics.chunks, statistics.time, statistics.messages);
}

void put_metadata(Bytes& out, const Metadata& metadata) {
  Bytes entry;
  put(entry, metadata.key);
  put(entry, metadata.value);
  put_record(out, Opcode::kMetadata, metadata.name, static_cast<std::uint32_t>(entry.size()),
             entry);
}

void put_metadata_index(Bytes& out, std::uint64_t offset, std::uint64_t bytes,
                        std::string_view name) {
  put_record(out, Opcode::kMetadataIndex, offset, bytes, name);
}

void put_summary_offset(Bytes& out, Opcode group, std::uint64_t start, std::uint64_t bytes) {
  put_record(out, Opcode::kSummaryOffset, static_cast<std::uint8_t>(group), start, bytes);
}

void put_data_end(Bytes& out, std::uint32_t data_crc) {
  put_record(out, Opcode::kDataEnd, data_crc);
}

void put_footer(Bytes& out, std::uint64_t summary_start, std::uint64_t offsets_start,
                std::span<const std::uint8_t> summary) {
  Bytes footer;
  put_record(footer, Opcode::kFooter, summary_start, offsets_start, std::uint32_t{0});
  footer.erase(footer.end() - sizeof(std::uint32_t), footer.end());
  put(footer, crc32(footer, crc32(summary)));
  put(out, footer);
  out.insert(out.end(), kMagic.begin(), kMagic.end());
}

}  // namespace orbbuf::mcap
