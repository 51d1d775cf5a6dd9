// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <set>
#include <string_view>
#include <vector>

#include "common/error.hpp"
#include "server/recording/mcap/record.hpp"

namespace orbbuf::mcap {

/// A message of the open chunk.
struct MessageAt {
  MessageHead head;
  std::uint64_t offset = 0;  ///< of its record, from the chunk's first record
};

/// How far a file of ours goes: closed chunks, with their message indexes behind each, and at the
/// end one that is open, without. Within a chunk the numbers of each channel grow.
struct Contents {
  std::uint64_t chunk_offset = 0;  ///< where the open chunk begins, or will; 0: nothing there yet
  std::uint32_t crc = 0;           ///< of the file up to there
  Bytes chunk_indexes;             ///< chunk index records of the closed chunks
  Statistics closed;               ///< of the closed chunks; `schemas` is not known here
  ChunkHead chunk;                 ///< of the open chunk, if there are messages in it
  std::vector<MessageAt> open;     ///< these
  std::map<std::uint16_t, std::uint32_t> highest;  ///< number of both, by channel

  /// What belongs to the file; whatever lies beyond is of no use.
  std::uint64_t end() const {
    return open.empty() ? chunk_offset : chunk_offset + kChunkHeadBytes + chunk.records_bytes;
  }
};

/// Counts a message for Contents::highest.
void raise(std::map<std::uint16_t, std::uint32_t>& highest, std::uint16_t channel,
           std::uint32_t sequence);

/// Counts messages that join those before them.
void extend(TimeSpan& time, bool is_first, const TimeSpan& more);

/// Makes the open chunk a closed one, whose message indexes these are.
void close_chunk(Contents& contents, const std::map<std::uint16_t, std::size_t>& counts,
                 std::span<const std::uint8_t> message_indexes);

/// What is in the file, up to where a server was killed while writing; a missing or a torn first
/// record is nothing. The last chunk becomes the open one, even if it had been closed. Of it,
/// everything from the first message on for which `is_beyond` holds is left out, unless it holds
/// in a chunk before: then so much is beyond that it is no leftover of a kill.
///
/// Reads some hundred bytes of each closed chunk and all of the last; changes nothing. An error if
/// the file cannot be read or is another program's, its library not beginning with `library`.
Result<Contents> scan(const std::filesystem::path& path, std::string_view library,
                      const std::function<bool(const MessageHead&)>& is_beyond);

/// The heads of the messages that are logged at one of these times. Reads the message indexes of
/// the chunks that reach over one of them, and the heads. contents: of scan().
Result<std::vector<MessageHead>> messages_at(const std::filesystem::path& path,
                                             const Contents& contents,
                                             const std::set<std::uint64_t>& times_ns);

}  // namespace orbbuf::mcap
