// SPDX-License-Identifier: Apache-2.0
#include "server/recording/mcap/scan.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include <algorithm>
#include <cerrno>
#include <optional>
#include <utility>

#include "common/unique_fd.hpp"
#include "common/wire.hpp"

namespace orbbuf::mcap {
namespace {

constexpr std::size_t kBlockBytes = 65536;

std::uint32_t joined(std::uint32_t crc, std::uint32_t next_crc, std::uint64_t next_bytes) {
  return static_cast<std::uint32_t>(
      ::crc32_combine(crc, next_crc, static_cast<z_off_t>(next_bytes)));
}

/// A file read in places. The first failure stays; what is asked for afterwards is not there.
class Source {
 public:
  Source(int fd, std::uint64_t bytes) : fd_(fd), bytes_(bytes) {}

  /// `count` bytes from `at` on, or fewer at the end of the file.
  Bytes read(std::uint64_t at, std::uint64_t count) {
    if (failed_ != 0 || at >= bytes_) return {};
    Bytes bytes(static_cast<std::size_t>(std::min(count, bytes_ - at)));
    std::size_t got = 0;
    while (got < bytes.size()) {
      const ssize_t more =
          ::pread(fd_, bytes.data() + got, bytes.size() - got, static_cast<off_t>(at + got));
      if (more < 0 && errno == EINTR) continue;
      if (more < 0) failed_ = errno;
      if (more <= 0) break;
      got += static_cast<std::size_t>(more);
    }
    if (failed_ != 0) got = 0;
    bytes.erase(bytes.begin() + static_cast<std::ptrdiff_t>(got), bytes.end());
    return bytes;
  }

  std::uint64_t bytes() const { return bytes_; }
  int failed() const { return failed_; }

 private:
  const int fd_;
  const std::uint64_t bytes_;
  int failed_ = 0;
};

struct RecordAt {
  Opcode opcode;
  std::uint64_t end;
};

/// The record at `at`, if all of it is there.
std::optional<RecordAt> record_at(Source& file, std::uint64_t at) {
  const Bytes prefix = file.read(at, kPrefixBytes);
  FieldReader fields(prefix);
  const auto opcode = static_cast<Opcode>(fields.u8());
  const std::uint64_t length = fields.u64();
  if (fields.is_short() || length > file.bytes() - at - kPrefixBytes) return std::nullopt;
  return RecordAt{opcode, at + kPrefixBytes + length};
}

/// Of the whole record at `at`; nothing if it is no chunk of ours.
std::optional<ChunkHead> chunk_head_at(Source& file, std::uint64_t at, std::uint64_t end) {
  const Bytes bytes = file.read(at, kChunkHeadBytes);
  FieldReader fields(bytes);
  fields.bytes(kPrefixBytes);
  ChunkHead head;
  head.time = {fields.u64(), 0};
  head.time.last_ns = fields.u64();
  head.records_bytes = fields.u64();
  head.records_crc = fields.u32();
  const bool is_compressed = fields.u32() != 0;
  const bool is_ours = fields.u64() == head.records_bytes && !is_compressed && !fields.is_short();
  if (!is_ours || end != at + kChunkHeadBytes + head.records_bytes) return std::nullopt;
  return head;
}

/// The message indexes behind a chunk.
struct MessageIndexes {
  Bytes bytes;
  std::map<std::uint16_t, std::size_t> counts;
  std::map<std::uint16_t, std::uint64_t> last_offsets;  // of messages, in the chunk
};

MessageIndexes message_indexes_at(Source& file, std::uint64_t at) {
  MessageIndexes indexes;
  while (const auto record = record_at(file, at)) {
    if (record->opcode != Opcode::kMessageIndex) break;
    const Bytes bytes = file.read(at, record->end - at);
    FieldReader fields(bytes);
    fields.bytes(kPrefixBytes);
    const std::uint16_t channel = fields.u16();
    const std::uint32_t entries_bytes = fields.u32();
    const auto entries = fields.bytes(entries_bytes);
    if (fields.is_short() || entries.size() < kIndexEntryBytes) break;
    FieldReader last(entries.last(kIndexEntryBytes));
    last.u64();
    indexes.last_offsets[channel] = last.u64();
    indexes.counts[channel] = entries.size() / kIndexEntryBytes;
    indexes.bytes.insert(indexes.bytes.end(), bytes.begin(), bytes.end());
    at = record->end;
  }
  return indexes;
}

std::optional<MessageHead> message_head_at(Source& file, std::uint64_t at) {
  const Bytes bytes = file.read(at, kMessageHeadBytes);
  FieldReader fields(bytes);
  const bool is_message = fields.u8() == static_cast<std::uint8_t>(Opcode::kMessage);
  fields.u64();
  MessageHead head;
  head.channel_id = fields.u16();
  head.sequence = fields.u32();
  head.time_ns = fields.u64();
  if (!is_message || fields.left() < sizeof head.time_ns) return std::nullopt;
  return head;
}

std::uint32_t crc_of(Source& file, std::uint64_t at, std::uint64_t end) {
  std::uint32_t crc = 0;
  for (; at < end && file.failed() == 0; at += kBlockBytes) {
    crc = wire::crc32(file.read(at, std::min<std::uint64_t>(kBlockBytes, end - at)), crc);
  }
  return crc;
}

/// Reads the closed chunks; false at the first that is not: it is the last, or nothing.
bool take_closed_chunk(Source& file, Contents& contents) {
  const std::uint64_t at = contents.chunk_offset;
  const auto record = record_at(file, at);
  if (!record || record->opcode != Opcode::kChunk) return false;
  const auto head = chunk_head_at(file, at, record->end);
  if (!head) return false;
  const auto indexes = message_indexes_at(file, record->end);
  const Bytes next = file.read(record->end + indexes.bytes.size(), 1);
  if (next.empty() || static_cast<Opcode>(next[0]) != Opcode::kChunk) return false;
  for (const auto& [channel, offset] : indexes.last_offsets) {
    const auto message = message_head_at(file, at + kChunkHeadBytes + offset);
    if (message) raise(contents.highest, channel, message->sequence);
  }
  contents.chunk = *head;
  close_chunk(contents, indexes.counts, indexes.bytes);
  return true;
}

bool is_known_in_chunk(Opcode opcode) {
  return opcode == Opcode::kSchema || opcode == Opcode::kChannel || opcode == Opcode::kMessage;
}

/// Reads the last chunk record by record. The length in its head is what was written for good;
/// what else the head says is counted again.
void take_open_chunk(Source& file, Contents& contents,
                     const std::function<bool(const MessageHead&)>& is_beyond) {
  const auto chunk = record_at(file, contents.chunk_offset);
  if (!chunk || chunk->opcode != Opcode::kChunk) return;
  const std::uint64_t begin = contents.chunk_offset + kChunkHeadBytes;
  const bool is_beyond_before = std::ranges::any_of(contents.highest, [&](const auto& highest) {
    return is_beyond({highest.first, highest.second, 0});
  });
  std::uint64_t end = begin;
  while (const auto record = record_at(file, end)) {
    if (!is_known_in_chunk(record->opcode) || record->end > chunk->end) break;
    const auto message = message_head_at(file, end);
    if (message) {
      if (!is_beyond_before && is_beyond(*message)) break;
      extend(contents.chunk.time, contents.open.empty(), {message->time_ns, message->time_ns});
      contents.open.push_back({*message, end - begin});
      raise(contents.highest, message->channel_id, message->sequence);
    }
    end = record->end;
  }
  contents.chunk.records_bytes = end - begin;
  contents.chunk.records_crc = crc_of(file, begin, end);
}

/// Of a closed chunk, whose message indexes begin at `indexes_at`.
void take_messages_at(Source& file, std::uint64_t chunk_at, std::uint64_t indexes_at,
                      const std::set<std::uint64_t>& times_ns, std::vector<MessageHead>& found) {
  const Bytes indexes = message_indexes_at(file, indexes_at).bytes;
  FieldReader records(indexes);
  while (records.left() > 0) {
    records.u8();
    FieldReader index(records.bytes(records.u64()));
    index.u16();
    index.u32();
    while (index.left() > 0) {
      const std::uint64_t time_ns = index.u64();
      const std::uint64_t offset = index.u64();
      if (!times_ns.contains(time_ns)) continue;
      const auto message = message_head_at(file, chunk_at + kChunkHeadBytes + offset);
      if (message) found.push_back(*message);
    }
  }
}

/// The end of magic and header; 0 if they are torn.
Result<std::uint64_t> header_end(Source& file, const std::filesystem::path& path,
                                 std::string_view library) {
  const Bytes magic = file.read(0, kMagic.size());
  const bool is_mcap =
      std::equal(magic.begin(), magic.end(), kMagic.begin(),
                 kMagic.begin() + static_cast<std::ptrdiff_t>(magic.size()),
                 [](std::uint8_t a, char b) { return a == static_cast<std::uint8_t>(b); });
  const auto header = record_at(file, kMagic.size());
  if (is_mcap && !header && file.bytes() < kBlockBytes) return 0;
  if (is_mcap && header && header->opcode == Opcode::kHeader && header->end < kBlockBytes) {
    const Bytes bytes = file.read(kMagic.size(), header->end - kMagic.size());
    FieldReader fields(bytes);
    fields.bytes(kPrefixBytes);
    fields.text();  // the profile
    if (fields.text().starts_with(library)) return header->end;
  }
  return Error{"resume from " + path.string() + ": not a recording by " + std::string(library)};
}

}  // namespace

void raise(std::map<std::uint16_t, std::uint32_t>& highest, std::uint16_t channel,
           std::uint32_t sequence) {
  auto& known = highest.emplace(channel, sequence).first->second;
  known = std::max(known, sequence);
}

void extend(TimeSpan& time, bool is_first, const TimeSpan& more) {
  time.first_ns = is_first ? more.first_ns : std::min(time.first_ns, more.first_ns);
  time.last_ns = is_first ? more.last_ns : std::max(time.last_ns, more.last_ns);
}

void close_chunk(Contents& contents, const std::map<std::uint16_t, std::size_t>& counts,
                 std::span<const std::uint8_t> message_indexes) {
  ChunkIndex index{contents.chunk, contents.chunk_offset, {}, message_indexes.size()};
  std::uint64_t at = contents.chunk_offset + kChunkHeadBytes + contents.chunk.records_bytes;
  for (const auto& [channel, count] : counts) {
    index.index_offsets.emplace_back(channel, at);
    constexpr std::size_t kFixedBytes = kPrefixBytes + 6;
    at += kFixedBytes + count * kIndexEntryBytes;
    contents.closed.messages[channel] += count;
  }
  put_chunk_index(contents.chunk_indexes, index);
  extend(contents.closed.time, contents.closed.chunks == 0, contents.chunk.time);
  ++contents.closed.chunks;

  const auto head = chunk_head(contents.chunk);
  contents.crc = wire::crc32(head, contents.crc);
  contents.crc = joined(contents.crc, contents.chunk.records_crc, contents.chunk.records_bytes);
  contents.crc = wire::crc32(message_indexes, contents.crc);
  contents.chunk_offset = at;
  contents.chunk = {};
  contents.open.clear();
}

Result<Contents> scan(const std::filesystem::path& path, std::string_view library,
                      const std::function<bool(const MessageHead&)>& is_beyond) {
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd && (errno == ENOENT || errno == ENOTDIR)) return Contents{};
  if (!fd) return system_error("open " + path.string(), errno);
  struct stat status {};
  if (::fstat(fd.get(), &status) != 0) return system_error("stat " + path.string(), errno);
  Source file(fd.get(), static_cast<std::uint64_t>(status.st_size));

  const auto header = header_end(file, path, library);
  if (file.failed() != 0) return system_error("read " + path.string(), file.failed());
  if (!header) return header.error();
  Contents contents;
  contents.chunk_offset = header.value();
  if (contents.chunk_offset == 0) return contents;
  contents.crc = crc_of(file, 0, contents.chunk_offset);
  while (take_closed_chunk(file, contents)) {
  }
  take_open_chunk(file, contents, is_beyond);
  if (file.failed() != 0) return system_error("read " + path.string(), file.failed());
  return contents;
}

Result<std::vector<MessageHead>> messages_at(const std::filesystem::path& path,
                                             const Contents& contents,
                                             const std::set<std::uint64_t>& times_ns) {
  std::vector<MessageHead> found;
  for (const MessageAt& message : contents.open) {
    if (times_ns.contains(message.head.time_ns)) found.push_back(message.head);
  }
  if (contents.chunk_indexes.empty()) return found;
  const UniqueFd fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (!fd) return system_error("open " + path.string(), errno);
  Source file(fd.get(), contents.chunk_offset);
  FieldReader records(contents.chunk_indexes);
  while (records.left() > 0) {
    records.u8();
    FieldReader index(records.bytes(records.u64()));
    const std::uint64_t first_ns = index.u64();
    const std::uint64_t last_ns = index.u64();
    const std::uint64_t at = index.u64();
    const std::uint64_t bytes = index.u64();
    const auto wanted = times_ns.lower_bound(first_ns);
    if (wanted == times_ns.end() || *wanted > last_ns) continue;
    take_messages_at(file, at, at + bytes, times_ns, found);
  }
  if (file.failed() != 0) return system_error("read " + path.string(), file.failed());
  return found;
}

}  // namespace orbbuf::mcap
