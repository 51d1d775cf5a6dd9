// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <set>
#include <span>
#include <string_view>
#include <vector>

#include "common/error.hpp"
#include "common/unique_fd.hpp"
#include "server/dataset/mcap/record.hpp"

namespace orbbuf::mcap {

/// An MCAP file, written once from front to back, in chunks of about a megabyte without
/// compression. In memory is one chunk, and 100 bytes for each before it. Blocking; reentrant.
class File {
 public:
  static constexpr std::uint64_t kChunkBytes = std::uint64_t{1} << 20;

  /// Makes the file, in place of one that is there. profile: what its header promises of all
  /// messages, `ros2` or nothing. library: what it names as its writer.
  static Result<File> create(std::filesystem::path path, std::string_view profile,
                             std::string_view library);

  /// Before the first message that needs it.
  void add(const Schema& schema);
  void add(const Channel& channel);
  bool has_schema(std::uint16_t id) const { return schema_ids_.contains(id); }
  bool has_channel(std::uint16_t id) const { return channel_ids_.contains(id); }

  /// True: with the message a chunk was full, and is written.
  Result<bool> add(const MessageHead& head, std::span<const std::uint8_t> data);

  /// What is left, the summary and the footer; nothing more follows.
  std::optional<Error> finish(const std::optional<Metadata>& metadata);

 private:
  explicit File(std::filesystem::path path) : path_(std::move(path)) {}

  std::optional<Error> write(std::span<const std::uint8_t> bytes);
  std::optional<Error> write_chunk();
  Bytes ending(const std::optional<Metadata>& metadata);

  std::filesystem::path path_;
  UniqueFd file_;
  std::uint64_t bytes_ = 0;  // written
  std::uint32_t crc_ = 0;    // of them
  std::set<std::uint16_t> schema_ids_;
  std::set<std::uint16_t> channel_ids_;
  Bytes schemas_;  // records, as are those below
  Bytes channels_;
  Bytes chunk_indexes_;
  Statistics statistics_;         // of the chunks that are written
  std::optional<TimeSpan> time_;  // of these; nothing: there is none
  Bytes chunk_;
  std::optional<TimeSpan> chunk_time_;                        // nothing: it has no message
  std::map<std::uint16_t, std::vector<IndexEntry>> entries_;  // of the chunk, by channel
};

}  // namespace orbbuf::mcap
