// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "common/error.hpp"
#include "common/unique_fd.hpp"
#include "daemon/spool/segment_queue.hpp"

namespace orbbuf {

/// The folder of a spool: its lock, the names of its files, and how far a robot's frames are freed.
/// Other files in it are left alone.
///
///   lock             locked by the orbbufd that uses the folder
///   NUMBER.segment   twelve digits or more; docs in segment.hpp
///   ROBOT.cursor     0  u32  magic, "OBSC"
///                    4  u16  version of this format, 1
///                    6  u64  number, in network order as all
///                   14  u64  offset: SpoolCursor
///                   22  u32  checksum of the bytes before it, wire::crc32()
///
/// Reentrant; blocks on the disk.
class SpoolFolder {
 public:
  /// Makes the folder if it is absent, and locks it. `robot_id`: a valid one. Throws
  /// std::runtime_error if the folder cannot be written, or another process uses it.
  SpoolFolder(std::filesystem::path path, const std::string& robot_id);

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path segment(std::uint64_t number) const;
  /// The numbers of all segments, ascending.
  std::vector<std::uint64_t> segments() const;
  /// A failure is logged. True if the segment is not there any more.
  bool remove(std::uint64_t number) const;

  /// As written last; nothing if there is none, or it is damaged.
  std::optional<SpoolCursor> read_cursor() const;
  /// In place, without a sync: after a power cut it may be older.
  std::optional<Error> write_cursor(const SpoolCursor& cursor);
  /// Has the device keep the names of new files, and the cursor.
  std::optional<Error> sync() const;

 private:
  std::filesystem::path path_;
  std::filesystem::path cursor_path_;
  UniqueFd lock_;
  UniqueFd folder_;
  UniqueFd cursor_;
};

}  // namespace orbbuf
