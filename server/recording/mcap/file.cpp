// SPDX-License-Identifier: Apache-2.0
#include "server/recording/mcap/file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <system_error>

#include "common/wire.hpp"
#include "server/recording/file_io.hpp"

namespace orbbuf::mcap {
namespace {

/// Of a chunk, while the index of those before has less than kIndexStep.
constexpr std::uint64_t kChunkBytes = 1 << 20;
constexpr std::uint64_t kChunkNs = 1'000'000'000;
/// Each time that the index has grown by this, chunks become twice as large; at most 2^kMostSteps.
constexpr std::size_t kIndexStep = std::size_t{2} << 20;
constexpr std::size_t kMostSteps = 6;

bool is_none_beyond(const MessageHead& /*head*/) { return false; }

/// The metadata, the data end, the summary and the footer, which stand at `at` in the file.
Bytes ending(const Contents& contents, const File::Described& described, std::uint64_t at) {
  Bytes out;
  Bytes metadata_index;
  if (described.metadata) {
    put_metadata(out, *described.metadata);
    put_metadata_index(metadata_index, at, out.size(), described.metadata->name);
  }
  put_data_end(out, wire::crc32(out, contents.crc));
  const std::size_t summary_at = out.size();
  Bytes offsets;
  const auto add_group = [&](Opcode opcode, std::span<const std::uint8_t> records) {
    if (records.empty()) return;
    put_summary_offset(offsets, opcode, at + out.size(), records.size());
    out.insert(out.end(), records.begin(), records.end());
  };
  Statistics statistics = contents.closed;
  statistics.schemas = described.schema_count;
  statistics.metadata = described.metadata ? 1 : 0;
  Bytes statistics_record;
  put_statistics(statistics_record, statistics);
  add_group(Opcode::kSchema, described.schemas);
  add_group(Opcode::kChannel, described.channels);
  add_group(Opcode::kStatistics, statistics_record);
  add_group(Opcode::kChunkIndex, contents.chunk_indexes);
  add_group(Opcode::kMetadataIndex, metadata_index);
  const std::size_t offsets_at = out.size();
  out.insert(out.end(), offsets.begin(), offsets.end());
  const Bytes summary(out.begin() + static_cast<std::ptrdiff_t>(summary_at), out.end());
  put_footer(out, at + summary_at, at + offsets_at, summary);
  return out;
}

}  // namespace

void Batch::add(const MessageHead& head, std::span<const std::uint8_t> data) {
  messages_.push_back({head, records_.size()});
  put_message(records_, head, data);
}

File::File(std::filesystem::path path, std::string library)
    : path_(std::move(path)), library_(std::move(library)) {}

std::optional<Error> File::recover(const std::function<bool(const MessageHead&)>& is_beyond) {
  auto contents = scan(path_, library_, is_beyond);
  if (!contents) return std::move(contents).error();
  contents_ = std::move(contents).value();
  return std::nullopt;
}

std::optional<Error> File::append(const Batch& batch) {
  assert(!batch.messages().empty());
  auto opened = open_at_end();
  if (!opened) return std::move(opened).error();
  UniqueFd fd = std::move(opened).value();
  if (contents_.chunk_offset == 0) {
    if (auto error = begin_file(fd.get())) return error;
  }
  if (is_full(batch)) {
    if (auto error = close_chunk(fd.get())) return error;
  }
  const bool is_first = contents_.open.empty();
  ChunkHead head = is_first ? ChunkHead{} : contents_.chunk;
  bool is_first_message = is_first;
  for (const auto& [message, offset] : batch.messages()) {
    extend(head.time, std::exchange(is_first_message, false), {message.time_ns, message.time_ns});
  }
  head.records_crc = wire::crc32(batch.records(), head.records_crc);
  head.records_bytes += batch.records().size();

  Bytes bytes;
  if (is_first) {
    const auto stored = chunk_head(head);
    bytes.assign(stored.begin(), stored.end());
  }
  bytes.insert(bytes.end(), batch.records().begin(), batch.records().end());
  if (auto error = write_at_end(fd.get(), bytes)) return error;
  if (!is_first) {
    if (auto error = write_head(fd.get(), head)) return error;
  }
  if (auto error = close_written(std::move(fd), path_)) return error;
  for (const auto& [message, offset] : batch.messages()) {
    contents_.open.push_back({message, (is_first ? 0 : contents_.chunk.records_bytes) + offset});
    raise(contents_.highest, message.channel_id, message.sequence);
  }
  contents_.chunk = head;
  return std::nullopt;
}

std::optional<Error> File::finish(const Described& described) {
  if (contents_.chunk_offset == 0) return std::nullopt;
  auto opened = open_at_end();
  if (!opened) return std::move(opened).error();
  UniqueFd fd = std::move(opened).value();
  if (!contents_.open.empty()) {
    if (auto error = close_chunk(fd.get())) return error;
  }
  const auto bytes = ending(contents_, described, contents_.chunk_offset);
  if (auto error = write_at_end(fd.get(), bytes)) return error;
  return close_written(std::move(fd), path_);
}

/// Cuts off what does not belong there: a summary, or what a failure left behind.
Result<UniqueFd> File::open_at_end() {
  const std::uint64_t end = contents_.end();
  if (end == 0) {
    std::error_code ignored;  // open() says why
    std::filesystem::create_directories(path_.parent_path(), ignored);
  }
  UniqueFd fd(::open(path_.c_str(), O_WRONLY | O_CLOEXEC | (end == 0 ? O_CREAT : 0), 0644));
  struct stat status {};
  if (fd && ::fstat(fd.get(), &status) != 0) return system_error("stat " + path_.string(), errno);
  const auto size = static_cast<std::uint64_t>(status.st_size);
  if (!fd && (errno != ENOENT || end == 0)) return system_error("open " + path_.string(), errno);
  if (!fd || size < end) {
    if (auto error = recover(is_none_beyond)) return std::move(*error);
    return Error{"write " + path_.string() + ": another program removed or truncated it"};
  }
  if (size == end) return fd;
  if (!contents_.open.empty()) {  // its head never promises more than there is
    if (auto error = write_head(fd.get(), contents_.chunk)) return std::move(*error);
  }
  if (::ftruncate(fd.get(), static_cast<off_t>(end)) != 0) {
    return system_error("truncate " + path_.string(), errno);
  }
  return fd;
}

/// On error the file ends where it did.
std::optional<Error> File::write_at_end(int fd, std::span<const std::uint8_t> bytes) {
  const auto end = static_cast<off_t>(contents_.end());
  if (::lseek(fd, end, SEEK_SET) < 0) return system_error("seek in " + path_.string(), errno);
  auto error = write_all(fd, bytes, path_);
  if (error && ::ftruncate(fd, end) != 0) return error;  // the next append cuts it
  return error;
}

std::optional<Error> File::write_head(int fd, const ChunkHead& head) {
  const auto bytes = chunk_head(head);
  const auto at = static_cast<off_t>(contents_.chunk_offset);
  std::optional<Error> error;
  if (::lseek(fd, at, SEEK_SET) < 0) error = system_error("seek in " + path_.string(), errno);
  if (!error) error = write_all(fd, bytes, path_);
  return error;
}

std::optional<Error> File::begin_file(int fd) {
  Bytes bytes(kMagic.begin(), kMagic.end());
  put_header(bytes, library_);
  if (auto error = write_at_end(fd, bytes)) return error;
  contents_.chunk_offset = bytes.size();
  contents_.crc = wire::crc32(bytes);
  return std::nullopt;
}

std::optional<Error> File::close_chunk(int fd) {
  std::map<std::uint16_t, std::vector<IndexEntry>> entries;
  for (const auto& [message, offset] : contents_.open) {
    entries[message.channel_id].push_back({message.time_ns, offset});
  }
  Bytes bytes;
  std::map<std::uint16_t, std::size_t> counts;
  for (const auto& [channel, of_channel] : entries) {
    put_message_index(bytes, channel, of_channel);
    counts[channel] = of_channel.size();
  }
  // A kill may have torn it.
  if (auto error = write_head(fd, contents_.chunk)) return error;
  if (auto error = write_at_end(fd, bytes)) return error;
  mcap::close_chunk(contents_, counts, bytes);
  return std::nullopt;
}

bool File::is_full(const Batch& batch) const {
  if (contents_.open.empty()) return false;
  const std::uint64_t first_ns = contents_.chunk.time.first_ns;
  const MessageHead& next = batch.messages().front().head;
  const std::uint64_t now_ns = next.time_ns;
  const bool goes_back = std::ranges::any_of(contents_.open, [&](const MessageAt& message) {
    return message.head.channel_id == next.channel_id && message.head.sequence >= next.sequence;
  });
  const auto steps = std::min(contents_.chunk_indexes.size() / kIndexStep, kMostSteps);
  return contents_.chunk.records_bytes + batch.records().size() > kChunkBytes << steps ||
         now_ns >= first_ns + (kChunkNs << steps) || goes_back;
}

}  // namespace orbbuf::mcap
