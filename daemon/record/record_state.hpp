// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/wire.hpp"
#include "daemon/record/record_format.hpp"

namespace orbbuf {

/// A frame that is held, or several items from `sequence` on, for acknowledgements.
struct KeptId {
  std::uint32_t session = 0;
  Sequence sequence = 0;
  wire::StreamId stream = wire::kFrames;

  friend bool operator==(const KeptId&, const KeptId&) = default;
};

/// How far the present session has come.
struct SessionProgress {
  Sequence captured = 0;
  std::int64_t last_capture_time_ns = 0;
  Sequence confirmed = 0;                               ///< the server has all frames below it
  Sequence settled_below = 0;                           ///< and all drop records of frames below it
  std::vector<record_format::StreamAccount> streams{};  ///< what the server has counts as settled

  friend bool operator==(const SessionProgress&, const SessionProgress&) = default;
};

/// What the robot's record says, in memory: its sessions, the frames of them that are held, and the
/// segments in which those are. It knows no files: its user writes the notes that it makes, and
/// removes the segments that it names. Reentrant.
class RecordState {
 public:
  static constexpr std::size_t kMostSessions = 10'000;
  /// Drop records of earlier sessions; of the oldest, only the totals are kept beyond that.
  static constexpr std::size_t kMostEarlierDrops = 65536;

  /// Frames that nothing will deliver any more.
  struct Lost {
    std::string session;
    std::uint64_t frames = 0;
    std::uint64_t items = 0;  ///< records with items of other streams that did not wait elsewhere

    friend bool operator==(const Lost&, const Lost&) = default;
  };
  /// A record for the journal.
  struct Note {
    std::uint8_t type = 0;
    std::vector<std::uint8_t> body;
    std::string session;
    std::vector<Sequence> released;         ///< what it says, for the index
    std::optional<wire::StreamId> items{};  ///< it has items of this stream
    Sequence first = 0;
    std::uint16_t count = 0;
  };

  RecordState(std::string robot_id, const std::string& session_id);

  // What the journal has, before begin(): the newest checkpoint, the indexes of the segments before
  // it, and the records behind it.

  /// False: it is none of this version.
  bool apply_checkpoint(record_format::Bytes body);
  void apply_account(record_format::Bytes body);
  void add_segment(std::uint32_t segment, std::uint64_t bytes) { segments_[segment].bytes = bytes; }
  /// `may_add`: sessions that are not known yet have frames, too; else these were forgotten.
  void apply(const record_format::Index& index, bool may_add);
  /// Begins the present session.
  void begin();

  // The present session.

  void give_up(std::span<const DropRecord> records);
  /// False: nothing is new.
  bool note(const SessionProgress& progress);
  /// Nothing more comes.
  void end();
  /// False: it is held already.
  bool keep(Sequence sequence) { return present().kept.add({sequence}); }
  /// Nothing: it is not held.
  std::optional<KeptId> find_present(Sequence sequence);
  /// It is written; adds it to its segment.
  void on_written(const KeptFrame& place, wire::StreamId stream = wire::kFrames);
  /// Items for take_notes(), to be sent if this process dies.
  void keep(const wire::Items& items);
  /// The items of a note are not written.
  void refuse_items(const Note& note);
  /// Those of these numbers that were kept are to be sent in any case. Returns how many of them are
  /// not held any more, and were not sent.
  std::uint64_t send_late(wire::StreamId stream, std::uint64_t begin, std::uint64_t end);
  std::size_t pending_item_bytes() const { return pending_item_bytes_; }

  // Sending late.

  /// The next frame of this robot, the oldest first, and its session's id; of the present session
  /// only those below `end`. It is taken from here on.
  struct Taken {
    KeptId id;
    std::string session;
    KeptFrame place;
  };
  std::optional<Taken> take_next(Sequence end);
  void give_back(const KeptId& id);
  bool is_held(const KeptId& id) { return find(id) != nullptr; }
  /// It is not held any more. Does nothing if it was not.
  void remove(const KeptId& id);

  // Accounts.

  /// Of each session of this robot of which something has changed since; several in a row for one
  /// with many drop records, of which only the last is final.
  std::vector<wire::Account> take_accounts();
  /// take_accounts() returns all again.
  void rewind_accounts();
  /// The server has the account of an earlier session: forgets it. False: it has frames still, or
  /// is none.
  bool settle(const std::string& session_id);

  // The journal.

  /// What is new since the last call.
  std::deque<Note> take_notes();
  std::vector<std::uint8_t> checkpoint() const;
  /// The oldest segment, if it is not the newest.
  std::optional<std::uint32_t> oldest_segment() const;
  bool is_needed(std::uint32_t segment) const { return segments_.at(segment).held > 0; }
  /// The segment is gone, and so are the frames in it.
  std::vector<Lost> remove_segment(std::uint32_t segment);
  std::vector<std::uint32_t> segments() const;
  std::uint64_t bytes() const;  ///< of all segments

  std::uint64_t held() const;        ///< frames
  std::uint64_t held_items() const;  ///< of other streams
  /// One line for each earlier session that the server has not settled, at most `most`.
  std::vector<std::string> describe_earlier(std::size_t most) const;

 private:
  struct Segment {
    std::uint64_t bytes = 0;
    std::uint64_t held = 0;  // frames
  };
  struct Session : record_format::Account {
    DropRanges given_up;  // all that the server may not have
    KeptFrames kept;
    std::map<wire::StreamId, KeptFrames> items;
    bool is_changed = true;  // its account was not taken since

    KeptFrames& kept_of(wire::StreamId stream) {
      return stream == wire::kFrames ? kept : items[stream];
    }
    std::uint64_t held_items() const;
  };
  using Sessions = std::map<std::uint32_t, Session>;

  Session& present() { return sessions_.rbegin()->second; }
  bool is_ours(const Session& session) const { return session.name.starts_with(prefix_); }
  bool is_present(const Session& session) const { return &session == &sessions_.rbegin()->second; }
  std::string id_of(const Session& session) const { return session.name.substr(prefix_.size()); }
  Sessions::iterator find(std::string_view name);
  KeptFrame* find(const KeptId& id);
  Session& add(std::string name);
  void remove(Session& session, KeptFrame& frame, wire::StreamId stream = wire::kFrames);
  void note_streams(Session& session, const std::vector<record_format::StreamAccount>& streams);
  void forget(Sessions::iterator session);
  void limit_drops();
  void note_gone(wire::StreamId stream, const KeptFrame& items);

  const std::string prefix_;  // of the names of this robot's sessions
  const std::string present_name_;
  std::uint32_t next_session_ = 0;
  Sessions sessions_;  // the oldest first; the present one is the last
  std::map<std::uint32_t, Segment> segments_;
  DropRanges new_drops_;  // of the present session, not noted yet
  bool is_noted_ = false;
  std::optional<SessionProgress> noted_progress_;
  std::map<std::string, std::vector<Sequence>> released_;  // not noted yet
  std::deque<Note> new_items_;                             // not noted yet
  /// Numbers of the present session that may wait elsewhere: from, to.
  std::map<wire::StreamId, std::vector<std::pair<Sequence, Sequence>>> gone_items_;
  std::size_t pending_item_bytes_ = 0;           // not written yet
  std::vector<record_format::Account> settled_;  // not noted yet
};

}  // namespace orbbuf
