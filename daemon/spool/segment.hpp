// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/unique_fd.hpp"

namespace orbbuf {

/// A segment: a file of the spool with frames of one session, in the order in which they came. This
/// is the specification of the file; integers are in network order, a text is a u16 length and its
/// bytes, a checksum is wire::crc32().
///
///   header     0  u32   magic, "OBSP"
///              4  u16   version of this format, 2
///              6  text  robot id
///                 text  session id
///                 u64   number of the segment, as in the file's name
///                 u32   checksum of the header before it
///   records    0  u32   magic, "OBSR"
///              4  u32   n, the bytes of the JPEG, at least 1
///              8  u64   sequence number
///             16  i64   capture time in ns
///             24  u32   exposure in ns
///             28  u16   width in pixels
///             30  u16   height
///             32  u32   of n, the bytes of the left image (EncodedFrame::left_bytes)
///             36  u32   checksum of the JPEG
///             40  u8    quality of the JPEG, 0: unknown
///             41  u32   checksum of the record before it, continued from the header's
///             45  u8[n] JPEG, a whole one (EncodedFrame::is_reduced())
///   footer     0  u32   magic, "OBSE"
///              4  u64   number of records
///             12  u64   the lowest sequence number of them
///             20  u64   the highest
///             28  u32   checksum of the footer before it, continued from the header's
///
/// The records follow each other without gaps. The footer is in the last 32 bytes of a segment that
/// was completed; a segment without one was left by a kill or a power cut, and may end in the
/// middle of a record. Checksums continue from the header's, so that a block of another segment is
/// not taken for one of this.
inline constexpr std::size_t kRecordHeadBytes = 45;
inline constexpr std::size_t kFooterBytes = 32;

/// Where a frame is in its segment.
struct SegmentRecord {
  std::uint64_t offset = 0;  ///< of the record in the file
  std::uint32_t jpeg_bytes = 0;
  Sequence sequence = 0;

  std::uint64_t end() const { return offset + kRecordHeadBytes + jpeg_bytes; }
  friend bool operator==(const SegmentRecord&, const SegmentRecord&) = default;
};

/// Some frames of one session.
struct FrameRange {
  std::uint64_t frames = 0;
  Sequence first = 0;  ///< the lowest number; 0 of no frames
  Sequence last = 0;   ///< the highest

  void add(Sequence sequence);
  void add(const FrameRange& other);
  bool covers(Sequence sequence) const {
    return frames > 0 && first <= sequence && sequence <= last;
  }
  friend bool operator==(const FrameRange&, const FrameRange&) = default;
};

struct SegmentHeader {
  std::string robot_id;
  std::string session_id;
  std::uint64_t number = 0;

  friend bool operator==(const SegmentHeader&, const SegmentHeader&) = default;
};

/// Writes one segment. Reentrant; blocks on the disk.
class SegmentWriter {
 public:
  /// Makes the file, which must not exist, and its header. No file is left on failure.
  static Result<SegmentWriter> create(const std::filesystem::path& file,
                                      const SegmentHeader& header);

  /// On failure the file is as before; if it cannot be made so, is_broken().
  Result<SegmentRecord> append(const EncodedFrame& frame);
  /// Has the device keep all that is written.
  std::optional<Error> sync();
  /// Adds the footer and syncs. Nothing is appended after that.
  std::optional<Error> complete();

  bool is_broken() const { return is_broken_; }
  std::uint64_t bytes() const { return bytes_; }

 private:
  friend class SegmentReader;
  SegmentWriter(std::filesystem::path path, UniqueFd file)
      : path_(std::move(path)), file_(std::move(file)) {}
  std::optional<Error> add_footer();
  Error undo(int error_number);

  std::filesystem::path path_;
  UniqueFd file_;
  std::uint64_t bytes_ = 0;
  std::uint32_t header_crc_ = 0;
  FrameRange range_;
  bool is_broken_ = false;
};

/// Reads one segment. Reentrant; blocks on the disk. What the file says is checked before it is
/// used.
class SegmentReader {
 public:
  /// Fails if the file cannot be read, or has no valid header.
  static Result<SegmentReader> open(const std::filesystem::path& file);

  const SegmentHeader& header() const { return header_; }
  std::uint64_t bytes() const { return bytes_; }
  /// What the footer says; nothing if there is none.
  std::optional<FrameRange> footer() const;
  /// The records whose heads are valid and that end within the file, in order; reads the heads
  /// only. What is between them, for example a bad block, is skipped.
  std::vector<SegmentRecord> scan() const;
  /// Fails if the record cannot be read, or one of its checksums is wrong.
  Result<FramePtr> read(const SegmentRecord& record) const;
  /// Completes a segment without a footer: cuts what follows the last of `records`, which scan()
  /// found, and adds the footer. Does not sync: after a power cut it can be done again.
  std::optional<Error> complete(const std::vector<SegmentRecord>& records);

 private:
  SegmentReader(std::filesystem::path path, UniqueFd file)
      : path_(std::move(path)), file_(std::move(file)) {}
  std::optional<SegmentRecord> record_at(std::uint64_t offset) const;
  std::optional<SegmentRecord> record_after(std::uint64_t offset) const;

  std::filesystem::path path_;
  UniqueFd file_;
  SegmentHeader header_;
  std::uint64_t header_bytes_ = 0;
  std::uint32_t header_crc_ = 0;
  std::uint64_t bytes_ = 0;
};

}  // namespace orbbuf
