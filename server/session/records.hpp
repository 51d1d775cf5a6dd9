// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "common/error.hpp"
#include "common/frame.hpp"
#include "common/journal/journal.hpp"
#include "common/wire.hpp"
#include "server/session/session_info.hpp"

/// The records of a session's journal (session_store.hpp says when they are written).
///
/// Each body begins with a u64, the *kept mark*: all records before that place of the journal, with
/// their images and their lines in times.txt, are on the device. A place is
/// (segment << 40) | offset. What follows is, by type, in network order; a text is a u16 length and
/// its bytes; a position is a u16 count, and for each stream its u16 id and u64 next number:
///
///   0  checkpoint   u8 version (2); SessionSummary
///   1  frame        RecordedFrame
///   2  items        u16 stream; u64 first; u64 next; u8, 1: late; the payload as it came
///   3  report       wire::Stats; i64 clock offset
///   4  account      wire::encode_account()
///   5  calibration  the text
///   6  end          u8, 1: the robot has ended the session
///   7  part         RecordedPart
namespace orbbuf {

/// A frame of a session. Its images are `images/NUMBER.jpg` and `images_right/NUMBER.jpg`.
struct RecordedFrame {
  Sequence sequence = 0;
  std::int64_t capture_time_ns = 0;
  std::int64_t arrived_ns = 0;    ///< since the Unix epoch
  std::uint32_t exposure_ns = 0;  ///< this and those below as EncodedFrame has them
  std::uint16_t width_px = 0;
  std::uint16_t height_px = 0;
  std::uint32_t bytes = 0;       ///< of both images together
  std::uint32_t left_bytes = 0;  ///< 0: there is no right image
  std::uint32_t crc = 0;         ///< of the left image
  std::uint32_t crc_right = 0;   ///< of the right one, if there is one
  std::uint32_t whole_bytes = 0;
  std::uint32_t whole_crc = 0;
  std::uint8_t quality = 0;
  bool is_late = false;
  bool is_replacing = false;  ///< late: the whole JPEG, in place of the reduced one that came live
  std::uint32_t replaced_bytes = 0;  ///< of that one

  bool is_stereo() const { return left_bytes > 0; }
  bool is_reduced() const { return whole_bytes > 0; }
  friend bool operator==(const RecordedFrame&, const RecordedFrame&) = default;
};

/// Items of a stream but kFrames, as they came.
struct RecordedItems {
  wire::StreamId stream = 0;
  std::uint64_t first = 0;
  std::uint64_t next = 0;  ///< behind the last of them
  std::vector<std::uint8_t> payload;
  /// The robot's record had them: the position is not theirs. The server had none of them.
  bool is_late = false;

  friend bool operator==(const RecordedItems&, const RecordedItems&) = default;
};

/// What the robot last reported, while the session was open.
struct RecordedReport {
  wire::Stats stats;
  std::int64_t clock_offset_ns = 0;

  friend bool operator==(const RecordedReport&, const RecordedReport&) = default;
};

struct RecordedCalibration {
  std::string text;

  friend bool operator==(const RecordedCalibration&, const RecordedCalibration&) = default;
};

/// The live stream is over, or interrupted: the session was closed.
struct RecordedEnd {
  bool has_ended = false;  ///< the robot has said so

  friend bool operator==(const RecordedEnd&, const RecordedEnd&) = default;
};

/// A part of the MCAP recording is complete: it has the records from one place to another.
struct RecordedPart {
  std::uint32_t number = 0;
  journal::Place from;
  journal::Place to;
  bool is_only_copy = false;      ///< the images of its frames are removed
  std::uint64_t image_bytes = 0;  ///< of these

  friend bool operator==(const RecordedPart&, const RecordedPart&) = default;
};

/// What became of the frames of a session.
struct SessionTotals {
  std::uint64_t live = 0;         ///< delivered by the live stream
  std::uint64_t late = 0;         ///< that it passed over, and that came afterwards
  std::uint64_t replaced = 0;     ///< of the live ones: reduced then, whole now
  std::uint64_t named = 0;        ///< by drop records; those of them that came late count as well
  std::uint64_t image_bytes = 0;  ///< that are not removed for a part
  std::uint64_t late_items = 0;   ///< records of them

  friend bool operator==(const SessionTotals&, const SessionTotals&) = default;
};

/// What is known of a session at one place of its journal: the body of a checkpoint.
struct SessionSummary {
  SessionInfo info;
  wire::Position position;  ///< of all streams, where the live one stands
  SessionTotals totals;
  Sequence end = 0;        ///< behind the highest number that came, live or late, or was named
  Sequence late_end = 0;   ///< behind the highest number that came late
  bool is_closed = false;  ///< no frame of the live stream came since a RecordedEnd
  SessionClosing closing;
  std::optional<wire::Account> account;  ///< the last one, without what was given up
  std::optional<RecordedPart> part;      ///< the last complete one
  journal::Place removed;                ///< the images of frames before it may be in parts only

  /// In an orderly way: no frame of the live stream follows.
  bool has_ended() const { return closing.has_ended || (account && account->has_ended); }
  /// Numbers below it were captured, as far as is known here.
  Sequence captured() const;
  /// Behind all numbers that came or were named; the robot's reports do not count.
  Sequence known_end() const { return std::max(end, account ? account->captured : 0); }
  /// A part is the only copy of images.
  bool has_removed() const { return removed != journal::Place{}; }
  /// The robot still has frames or items of it, to send them late.
  bool is_held() const { return account && account->is_held(); }

  friend bool operator==(const SessionSummary&, const SessionSummary&) = default;
};

using RecordBody = std::variant<SessionSummary, RecordedFrame, RecordedItems, RecordedReport,
                                wire::Account, RecordedCalibration, RecordedEnd, RecordedPart>;

/// The type of a record with that body, for journal::Writer::append().
std::uint8_t type_of(const RecordBody& body);
/// With the kept mark in front.
std::vector<std::uint8_t> encode(const RecordBody& body, const journal::Place& kept);

struct SessionRecord {
  journal::Place kept;
  RecordBody body;

  friend bool operator==(const SessionRecord&, const SessionRecord&) = default;
};

/// Nothing: it is none of these, or of a later version.
std::optional<SessionRecord> decode_record(std::uint8_t type, std::span<const std::uint8_t> bytes);

/// Whether the views may be complete after that record, if they were before: they are made after an
/// end, and a part is not in them.
bool is_clean_after(const RecordBody& body, bool is_clean);

/// The summary after that record.
void add(const RecordBody& body, SessionSummary& summary);

/// The frames that the record names as dropped.
std::vector<DropRecord> named_by(const RecordBody& body);

/// Reads the records of a session one after the other, also while they are written. Blocking;
/// reentrant.
class RecordReader {
 public:
  explicit RecordReader(std::filesystem::path folder, journal::Place from = {})
      : reader_(std::move(folder), from) {}

  struct Entry {
    journal::Place place;
    journal::Place end;
    SessionRecord record;
  };

  /// The next record; nothing if there is none yet. What cannot be read counts as damage.
  Result<std::optional<Entry>> next();

  const journal::Place& place() const { return reader_.place(); }
  std::uint64_t damaged_bytes() const { return reader_.damaged_bytes() + unknown_bytes_; }

 private:
  journal::Reader reader_;
  std::uint64_t unknown_bytes_ = 0;
};

/// Behind each record.
inline constexpr journal::Place kNowhere{std::numeric_limits<std::uint32_t>::max(), 0};

/// Hands on the records of one kind from `from` on that are before `to`.
template <class Record, class Take>
std::optional<Error> for_each(const std::filesystem::path& folder, Take take,
                              const journal::Place& from = {},
                              const journal::Place& to = kNowhere) {
  RecordReader reader(folder, from);
  for (;;) {
    const auto entry = reader.next();
    if (!entry) return entry.error();
    if (!entry.value() || entry.value()->place >= to) return std::nullopt;
    const auto* const record = std::get_if<Record>(&entry.value()->record.body);
    if (record != nullptr) take(*record);
  }
}

}  // namespace orbbuf
