// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <initializer_list>
#include <optional>
#include <span>
#include <vector>

#include "common/error.hpp"
#include "common/unique_fd.hpp"

/// An append-only log of records in a folder: what is in it has happened, and nothing else has.
///
/// The log is a row of files of bounded size, its segments: `journal.000000`, `journal.000001`, ...
/// A segment is a row of records without gaps; integers are in network order:
///
///    0  u32    magic, "OBJR"
///    4  u32    n, the bytes of the body
///    8  u8     type, the user's but kCheckpoint
///    9  u32    crc32() of the bytes 4 to 8, continued by that of the body
///   13  u8[n]  body
///
/// The first record of each segment is a checkpoint, whose body is the user's as well: what a
/// reader must know of all segments before. So the newest segment tells where the log stands, and
/// the older ones can be removed if the checkpoint has all that is needed of them.
///
/// What a kill or a power cut leaves behind the last valid record is no record: Reader stops before
/// it, and Writer::open() cuts it off. What is invalid between valid records is damage: Reader
/// passes it over and counts it.
namespace orbbuf::journal {

inline constexpr std::uint8_t kCheckpoint = 0;
inline constexpr std::size_t kHeadBytes = 13;
/// A record that claims a longer body is invalid.
inline constexpr std::uint32_t kMostBodyBytes = 64U << 20;

/// Where a record begins, or one may.
struct Place {
  std::uint32_t segment = 0;
  std::uint64_t offset = 0;

  auto operator<=>(const Place&) const = default;  // NOLINT(modernize-use-nullptr): clang-tidy 14
};

struct Record {
  std::uint8_t type = kCheckpoint;
  Place place;
  Place end;                           ///< behind it
  std::span<const std::uint8_t> body;  ///< valid until the next call of the reader
};

std::filesystem::path segment_path(const std::filesystem::path& folder, std::uint32_t segment);

/// The numbers of the segments in `folder`, ascending; no folder: none. Blocking.
Result<std::vector<std::uint32_t>> segments_in(const std::filesystem::path& folder);

/// Reads records one after the other, also while they are written. Blocking; reentrant. Memory: the
/// largest record, at least kBlockBytes.
class Reader {
 public:
  static constexpr std::size_t kBlockBytes = 64UL * 1024;

  /// Begins at `from`, where a record begins, or at the first segment after it that is there.
  explicit Reader(std::filesystem::path folder, Place from = {});

  /// The next record; nothing if there is none yet: later calls look again. An error if a file
  /// cannot be read.
  Result<std::optional<Record>> next();

  /// Behind the last valid record that next() returned, or where it began.
  const Place& place() const { return place_; }

  /// Bytes that next() passed over between valid records, or at the end of a segment that another
  /// one follows.
  std::uint64_t damaged_bytes() const { return damaged_bytes_; }

 private:
  std::optional<Error> open(std::uint32_t segment);
  Result<std::span<const std::uint8_t>> bytes_at(std::uint64_t offset, std::size_t count);
  Result<std::optional<Record>> record_at(std::uint64_t offset);
  Result<std::optional<std::uint64_t>> find_record(std::uint64_t from);
  Result<std::optional<Record>> find_in_segment();
  Result<std::optional<std::uint32_t>> next_segment() const;
  void leave_segment();

  const std::filesystem::path folder_;
  Place place_;
  UniqueFd file_;  // of place_.segment, if it is open
  std::vector<std::uint8_t> block_;
  std::uint64_t block_begin_ = 0;  // offset of block_ in the file
  std::uint64_t damaged_bytes_ = 0;
};

/// Adds records. One descriptor stays open. Blocking; reentrant.
class Writer {
 public:
  /// The body of a checkpoint at this moment.
  using Checkpoint = std::function<std::vector<std::uint8_t>()>;

  /// A segment that has reached `segment_bytes` is followed by a new one. `is_synced`: sync() will
  /// be called now and then; else the user has the file system synced.
  Writer(std::filesystem::path folder, std::uint64_t segment_bytes, bool is_synced,
         Checkpoint checkpoint);

  /// Goes on at `end`, a reader's place(), and removes what is behind it. Not called: the journal
  /// is new. Touches nothing if there is no such file: then the first append() makes it.
  std::optional<Error> open(const Place& end);

  /// Adds a record whose body is `parts`, one after the other, in one write; before it, if it is
  /// time, a segment with its checkpoint. Returns where the record is. On error the log is as
  /// before, unless even that fails: then the next append() restores it first. The folder must
  /// exist.
  Result<Place> append(std::uint8_t type,
                       std::initializer_list<std::span<const std::uint8_t>> parts);

  /// Has the device keep all that was appended. Requires is_synced.
  std::optional<Error> sync();

  /// Begins a new segment with the next append(), however full the present one is.
  void end_segment() { is_segment_due_ = true; }

  /// Removes segment number `segment`, which is not the one that is written.
  std::optional<Error> remove(std::uint32_t segment);

  const Place& end() const { return end_; }
  /// False: another program has removed or moved the file that is written, or its folder.
  bool is_there() const;

 private:
  std::optional<Error> begin_segment(std::uint32_t segment);
  std::optional<Error> write(std::uint8_t type,
                             std::initializer_list<std::span<const std::uint8_t>> parts);
  std::optional<Error> restore();

  const std::filesystem::path folder_;
  const std::uint64_t segment_bytes_;
  const bool is_synced_;
  const Checkpoint checkpoint_;
  UniqueFd file_;
  Place end_;
  std::vector<std::uint8_t> record_;  // being written; keeps its storage
  bool is_segment_due_ = false;
  bool must_restore_ = false;        // a failed append left something behind end_
  bool is_folder_unsynced_ = false;  // a segment is new
  std::vector<UniqueFd> unsynced_;   // earlier segments
};

}  // namespace orbbuf::journal
