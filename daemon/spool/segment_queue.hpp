// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/frame.hpp"
#include "daemon/spool/segment.hpp"

namespace orbbuf {

struct SpooledFrame {
  std::string session_id;
  FramePtr frame;
};

/// Up to where the frames of a spool have been freed: all segments below `number`, and in that one
/// all records that begin below `offset`.
struct SpoolCursor {
  std::uint64_t number = 0;
  std::uint64_t offset = 0;

  friend bool operator==(const SpoolCursor&, const SpoolCursor&) = default;
};

/// Which frames the segments of a spool hold, and how far they have been read ahead, handed out and
/// freed, oldest first. It knows no files: its user reads, writes and removes them as it says.
///
/// A segment's records are in memory only while it is written, or read and freed, and of the one in
/// which a frame was forgotten last: of the others it keeps the number of frames, and the lowest
/// and the highest number. An index of the records is loaded when it is needed.
///
/// Reentrant. Sequence numbers may come in any order, each once in a session.
class SegmentQueue {
 public:
  /// Frames of `session_id`, the present session, may be forgotten.
  explicit SegmentQueue(std::string session_id) : session_id_(std::move(session_id)) {}

  /// Frames that nothing will deliver any more.
  struct Lost {
    std::string session_id;
    FrameRange range;

    friend bool operator==(const Lost&, const Lost&) = default;
  };
  /// A segment to remove.
  struct Evicted {
    std::uint64_t number = 0;
    Lost lost;  ///< no frames if it was another robot's, or all were freed
  };
  /// A record, and where it is.
  struct Place {
    std::uint64_t number = 0;  ///< of the segment
    std::size_t index = 0;     ///< within the segment
    SegmentRecord record;
  };

  // The segments, in the order of their numbers.

  /// A complete segment of this robot that was there before. `range`: of all its records.
  /// `freed_below`: the records that begin below this offset were freed.
  void add_complete(const SegmentHeader& header, std::uint64_t bytes, const FrameRange& range,
                    std::uint64_t freed_below);
  /// One that only takes room: another robot's, or unreadable.
  void add_foreign(std::uint64_t number, std::uint64_t bytes);
  /// Begins the segment of the present session that add_record() adds to.
  void begin(std::uint64_t number, std::uint64_t bytes);
  /// `is_forgotten`: it is not held.
  void add_record(const SegmentRecord& record, bool is_forgotten);
  /// Nothing more is added to the one begun. `bytes`: of the whole file.
  void complete(std::uint64_t bytes);

  // The index of a segment.

  /// The segment of which the records are needed next, if any.
  std::optional<std::uint64_t> to_load() const;
  /// `records`: those found in its file. Returns how many frames less it has than it should.
  std::uint64_t load(std::uint64_t number, const std::vector<SegmentRecord>& records);

  // Reading and freeing.

  /// The next record to read ahead; nothing if there is none, or its index is not loaded.
  std::optional<Place> to_read();
  /// What was read at `place`; null: it cannot be read. Returns false if a frame is lost by that.
  /// Does nothing if rewind() was called since to_read().
  bool put(const Place& place, FramePtr frame);
  /// How many frames next() would hand out now.
  std::size_t ready() const { return ready_.size(); }
  std::optional<SpooledFrame> next();
  /// Frees the oldest `frames` of those handed out, at most all.
  void acknowledge(std::uint64_t frames);
  /// Those handed out are to be read again; returns those that were evicted in the meantime.
  std::vector<Lost> rewind();
  /// A frame of the present session is not held any more. Does nothing if it is not held.
  void forget(Sequence sequence);

  // Removing.

  /// A complete segment of which nothing is held, which is no longer part of the queue.
  std::optional<std::uint64_t> take_finished();
  /// Takes out the oldest segment with frames, but not the one that is written; nothing if there is
  /// no other. Frames that are handed out are not lost yet. Forgotten ones that await load() count
  /// as lost.
  std::optional<Evicted> evict_frames();
  /// Takes out another robot's oldest one, or else as evict_frames().
  std::optional<Evicted> evict();

  SpoolCursor cursor() const;
  std::uint64_t bytes() const;   ///< of all files
  std::uint64_t frames() const;  ///< held
  /// Frames that are held of each session, the oldest session first.
  std::vector<Lost> held() const;
  /// Different sessions with frames.
  std::size_t sessions() const;

 private:
  struct Entry {
    SegmentRecord record;
    bool is_gone = false;  // not held: freed, forgotten or damaged
  };
  struct Segment {
    std::uint64_t number = 0;
    std::uint64_t bytes = 0;
    std::string session_id;
    bool is_foreign = false;
    bool is_complete = false;
    bool is_loaded = false;
    std::vector<Entry> entries;   // if it is loaded
    std::size_t gone_before = 0;  // all entries before it are gone
    std::uint64_t records = 0;    // in the file, if it is not loaded
    FrameRange unloaded;          // held, if it is not loaded
    std::uint64_t freed_below =
        0;                         // all records that begin before it are gone, if it is not loaded
    std::set<Sequence> skipped;    // forgotten or damaged
    std::set<Sequence> to_forget;  // those that may be in it, until it is loaded

    FrameRange held() const;
    std::uint64_t free_end() const;
    void drop(std::size_t index);
    bool skip(Sequence sequence);
    void unload();
  };
  struct HandedOut {
    std::uint64_t number = 0;
    std::size_t index = 0;
    std::string session_id;
    Sequence sequence = 0;
    bool is_evicted = false;
  };
  struct Ready {
    std::uint64_t number = 0;
    std::size_t index = 0;
    SpooledFrame frame;
  };

  Segment* find(std::uint64_t number);
  bool is_needed(const Segment& segment) const;
  std::deque<Segment>::const_iterator oldest() const;
  Evicted take_out(std::size_t index);

  const std::string session_id_;
  std::deque<Segment> segments_;
  std::uint64_t last_number_ = 0;    // ever
  std::uint64_t forgot_number_ = 0;  // the segment that was loaded last for forget()
  std::uint64_t read_number_ = 0;    // the next record to read: the segment, or the first after it
  std::size_t read_index_ = 0;
  std::deque<Ready> ready_;
  std::deque<HandedOut> handed_out_;
};

}  // namespace orbbuf
