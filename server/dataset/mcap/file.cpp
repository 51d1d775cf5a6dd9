// SPDX-License-Identifier: Apache-2.0
#include "server/dataset/mcap/file.hpp"

#include <fcntl.h>

#include <algorithm>
#include <cerrno>
#include <utility>

#include "common/crc32.hpp"
#include "common/file_io.hpp"

namespace orbbuf::mcap {
namespace {

void extend(std::optional<TimeSpan>& time, const TimeSpan& more) {
  if (!time) time = more;
  time->first_ns = std::min(time->first_ns, more.first_ns);
  time->last_ns = std::max(time->last_ns, more.last_ns);
}

}  // namespace

Result<File> File::create(std::filesystem::path path, std::string_view profile,
                          std::string_view library) {
  File file(std::move(path));
  file.file_ = UniqueFd(::open(file.path_.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (!file.file_) return system_error("create " + file.path_.string(), errno);
  Bytes head(kMagic.begin(), kMagic.end());
  put_header(head, profile, library);
  if (auto error = file.write(head)) return std::move(*error);
  return file;
}

void File::add(const Schema& schema) {
  schema_ids_.insert(schema.id);
  put_schema(schemas_, schema);
  put_schema(chunk_, schema);
}

void File::add(const Channel& channel) {
  channel_ids_.insert(channel.id);
  put_channel(channels_, channel);
  put_channel(chunk_, channel);
}

Result<bool> File::add(const MessageHead& head, std::span<const std::uint8_t> data) {
  entries_[head.channel_id].push_back({head.time_ns, chunk_.size()});
  extend(chunk_time_, {head.time_ns, head.time_ns});
  put_message(chunk_, head, data);
  if (chunk_.size() < kChunkBytes) return false;
  if (auto error = write_chunk()) return std::move(*error);
  return true;
}

std::optional<Error> File::finish(const std::optional<Metadata>& metadata) {
  if (chunk_time_) {
    if (auto error = write_chunk()) return error;
  }
  if (auto error = write(ending(metadata))) return error;
  return close_written(std::move(file_), path_);
}

std::optional<Error> File::write(std::span<const std::uint8_t> bytes) {
  bytes_ += bytes.size();
  crc_ = crc32(bytes, crc_);
  return write_all(file_.get(), bytes, path_);
}

/// And the indexes of its messages.
std::optional<Error> File::write_chunk() {
  ChunkIndex index{{*chunk_time_, chunk_.size(), crc32(chunk_)}, bytes_, {}, 0};
  Bytes out;
  put_chunk(out, index.chunk, chunk_);
  const std::uint64_t indexes_at = out.size();
  for (const auto& [channel, entries] : entries_) {
    index.index_offsets.emplace_back(channel, bytes_ + out.size());
    put_message_index(out, channel, entries);
    statistics_.messages[channel] += entries.size();
  }
  index.index_bytes = out.size() - indexes_at;
  put_chunk_index(chunk_indexes_, index);
  extend(time_, *chunk_time_);
  ++statistics_.chunks;
  chunk_.clear();
  chunk_time_.reset();
  entries_.clear();
  return write(out);
}

/// The metadata, the data end, the summary and the footer.
Bytes File::ending(const std::optional<Metadata>& metadata) {
  Bytes out;
  Bytes metadata_index;
  if (metadata) {
    put_metadata(out, *metadata);
    put_metadata_index(metadata_index, bytes_, out.size(), metadata->name);
  }
  put_data_end(out, crc32(out, crc_));
  const std::size_t summary_at = out.size();
  Bytes offsets;
  const auto add_group = [&](Opcode opcode, const Bytes& records) {
    if (records.empty()) return;
    put_summary_offset(offsets, opcode, bytes_ + out.size(), records.size());
    out.insert(out.end(), records.begin(), records.end());
  };
  statistics_.schemas = static_cast<std::uint16_t>(schema_ids_.size());
  statistics_.metadata = metadata ? 1 : 0;
  statistics_.time = time_.value_or(TimeSpan{});
  Bytes statistics;
  put_statistics(statistics, statistics_);
  add_group(Opcode::kSchema, schemas_);
  add_group(Opcode::kChannel, channels_);
  add_group(Opcode::kStatistics, statistics);
  add_group(Opcode::kChunkIndex, chunk_indexes_);
  add_group(Opcode::kMetadataIndex, metadata_index);
  const std::size_t offsets_at = out.size();
  out.insert(out.end(), offsets.begin(), offsets.end());
  const Bytes summary(out.begin() + static_cast<std::ptrdiff_t>(summary_at), out.end());
  put_footer(out, bytes_ + summary_at, bytes_ + offsets_at, summary);
  return out;
}

}  // namespace orbbuf::mcap
