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

void put_bytes(Bytes& out, std::span<const std::uint8_t> bytes) {
  out.insert(out.end(), bytes.begin(), bytes.end());
}

void put_text(Bytes& out, std::string_view text) {
  put(out, static_cast<std::uint32_t>(text.size()));
  out.insert(out.end(), text.begin(), text.end());
}

/// What `put_fields` appends, as a record.
template <class PutFields>
void put_record(Bytes& out, Opcode opcode, PutFields put_fields) {
  out.push_back(static_cast<std::uint8_t>(opcode));
  const std::size_t length_at = out.size();
  put(out, std::uint64_t{0});
  const std::size_t begin = out.size();
  put_fields();
  const std::uint64_t length = out.size() - begin;
  for (std::size_t i = 0; i < sizeof length; ++i) {
    out[length_at + i] = static_cast<std::uint8_t>(length >> (8 * i));
  }
}

void put_time(Bytes& out, const TimeSpan& time) {
  put(out, time.first_ns);
  put(out, time.last_ns);
}

/// A map of which each entry takes kEntryBytes.
template <class Map>
void put_map(Bytes& out, const Map& map) {
  constexpr std::size_t kEntryBytes = 10;
  put(out, static_cast<std::uint32_t>(map.size() * kEntryBytes));
  for (const auto& [key, value] : map) {
    put(out, key);
    put(out, value);
  }
}

}  // namespace

void put_header(Bytes& out, std::string_view library) {
  put_record(out, Opcode::kHeader, [&] {
    put_text(out, "");  // no profile: nothing is promised of the messages
    put_text(out, library);
  });
}

void put_schema(Bytes& out, const Schema& schema) {
  put_record(out, Opcode::kSchema, [&] {
    put(out, schema.id);
    put_text(out, schema.name);
    put_text(out, schema.encoding);
    put(out, static_cast<std::uint32_t>(schema.data.size()));
    put_bytes(out, schema.data);
  });
}

void put_channel(Bytes& out, const Channel& channel) {
  put_record(out, Opcode::kChannel, [&] {
    put(out, channel.id);
    put(out, channel.schema_id);
    put_text(out, channel.topic);
    put_text(out, channel.message_encoding);
    put(out, std::uint32_t{0});  // no metadata
  });
}

void put_message(Bytes& out, const MessageHead& head, std::span<const std::uint8_t> data) {
  put_record(out, Opcode::kMessage, [&] {
    put(out, head.channel_id);
    put(out, head.sequence);
    put(out, head.time_ns);
    put(out, head.time_ns);
    put_bytes(out, data);
  });
}

void put_chunk(Bytes& out, const ChunkHead& head, std::span<const std::uint8_t> records) {
  put_record(out, Opcode::kChunk, [&] {
    put_time(out, head.time);
    put(out, head.records_bytes);
    put(out, head.records_crc);
    put_text(out, "");  // no compression
    put(out, head.records_bytes);
    put_bytes(out, records);
  });
}

void put_message_index(Bytes& out, std::uint16_t channel_id, std::span<const IndexEntry> entries) {
  put_record(out, Opcode::kMessageIndex, [&] {
    put(out, channel_id);
    put(out, static_cast<std::uint32_t>(entries.size() * 2 * sizeof(std::uint64_t)));
    for (const IndexEntry& entry : entries) {
      put(out, entry.time_ns);
      put(out, entry.offset);
    }
  });
}

void put_chunk_index(Bytes& out, const ChunkIndex& index) {
  put_record(out, Opcode::kChunkIndex, [&] {
    put_time(out, index.chunk.time);
    put(out, index.offset);
    put(out, kChunkHeadBytes + index.chunk.records_bytes);
    put_map(out, index.index_offsets);
    put(out, index.index_bytes);
    put_text(out, "");
    put(out, index.chunk.records_bytes);
    put(out, index.chunk.records_bytes);
  });
}

void put_statistics(Bytes& out, const Statistics& statistics) {
  std::uint64_t messages = 0;
  for (const auto& [channel, count] : statistics.messages) messages += count;
  put_record(out, Opcode::kStatistics, [&] {
    put(out, messages);
    put(out, statistics.schemas);
    put(out, static_cast<std::uint32_t>(statistics.messages.size()));
    put(out, std::uint32_t{0});  // attachments
    put(out, statistics.metadata);
    put(out, statistics.chunks);
    put_time(out, statistics.time);
    put_map(out, statistics.messages);
  });
}

void put_metadata(Bytes& out, const Metadata& metadata) {
  put_record(out, Opcode::kMetadata, [&] {
    put_text(out, metadata.name);
    Bytes entry;
    put_text(entry, metadata.key);
    put_text(entry, metadata.value);
    put(out, static_cast<std::uint32_t>(entry.size()));
    put_bytes(out, entry);
  });
}

void put_metadata_index(Bytes& out, std::uint64_t offset, std::uint64_t bytes,
                        std::string_view name) {
  put_record(out, Opcode::kMetadataIndex, [&] {
    put(out, offset);
    put(out, bytes);
    put_text(out, name);
  });
}

void put_summary_offset(Bytes& out, Opcode group, std::uint64_t start, std::uint64_t bytes) {
  put_record(out, Opcode::kSummaryOffset, [&] {
    put(out, static_cast<std::uint8_t>(group));
    put(out, start);
    put(out, bytes);
  });
}

void put_data_end(Bytes& out, std::uint32_t data_crc) {
  put_record(out, Opcode::kDataEnd, [&] { put(out, data_crc); });
}

void put_footer(Bytes& out, std::uint64_t summary_start, std::uint64_t offsets_start,
                std::span<const std::uint8_t> summary) {
  Bytes footer;
  put_record(footer, Opcode::kFooter, [&] {
    put(footer, summary_start);
    put(footer, offsets_start);
    put(footer, std::uint32_t{0});
  });
  footer.erase(footer.end() - sizeof(std::uint32_t), footer.end());
  put(footer, crc32(footer, crc32(summary)));
  put_bytes(out, footer);
  out.insert(out.end(), kMagic.begin(), kMagic.end());
}

}  // namespace orbbuf::mcap
