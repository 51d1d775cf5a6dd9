// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/error.hpp"
#include "common/unique_fd.hpp"
#include "server/recording/mcap/record.hpp"
#include "server/recording/mcap/scan.hpp"

namespace orbbuf::mcap {

/// What goes into a file together or not at all.
class Batch {
 public:
  void add(const Schema& schema) { put_schema(records_, schema); }
  void add(const Channel& channel) { put_channel(records_, channel); }
  void add(const MessageHead& head, std::span<const std::uint8_t> data);

  const Bytes& records() const { return records_; }
  /// Offsets are from the batch's beginning.
  const std::vector<MessageAt>& messages() const { return messages_; }

 private:
  Bytes records_;
  std::vector<MessageAt> messages_;
};

/// An MCAP file that grows by batches of messages, in chunks of about a second or a megabyte,
/// without compression. The index of the chunks stays in memory until finish(); chunks become
/// larger as it grows, up to 64 times, so that a week needs about 11 MiB.
///
/// A batch is in the file for good once append() has returned, its chunk being open or not: it is
/// written behind the chunk, and then the chunk's head is written again, with it in. So the
/// death of this process at any moment leaves whole chunks with every batch that was appended, in
/// the last one, and perhaps a piece of another behind them, which the next append() cuts off. The
/// message indexes of a chunk are written when it is full, the summary by finish(). No fsync.
/// The file is opened for each call, as LineFile does it. Blocking; reentrant.
class File {
 public:
  /// library: what the file's header names as its writer.
  File(std::filesystem::path path, std::string library);

  /// Reads what is there already: see scan().
  std::optional<Error> recover(const std::function<bool(const MessageHead&)>& is_beyond);

  /// Requires a batch with messages, whose channels stand in it or were in one before. On error the
  /// file is as before, unless even that fails: then the next append cuts it first. A file that
  /// was removed is an error once, and begins again then.
  std::optional<Error> append(const Batch& batch);

  /// Writes indexes and summary, which more batches may replace. summary: the schema records, and
  /// then the channel records, of all channels with messages. metadata: a record, or nothing. Does
  /// nothing if there is no file.
  struct Described {
    Bytes schemas;
    Bytes channels;
    std::uint16_t schema_count = 0;
    std::optional<Metadata> metadata{};
  };
  std::optional<Error> finish(const Described& described);

  const Contents& contents() const { return contents_; }
  const std::filesystem::path& path() const { return path_; }

 private:
  Result<UniqueFd> open_at_end();
  std::optional<Error> write_at_end(int fd, std::span<const std::uint8_t> bytes);
  std::optional<Error> write_head(int fd, const ChunkHead& head);
  std::optional<Error> begin_file(int fd);
  std::optional<Error> close_chunk(int fd);
  bool is_full(const Batch& batch) const;

  std::filesystem::path path_;
  std::string library_;
  Contents contents_;
};

}  // namespace orbbuf::mcap
