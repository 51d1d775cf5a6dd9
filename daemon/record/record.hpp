// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <limits>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "common/drop_record.hpp"
#include "common/frame.hpp"
#include "common/journal/journal.hpp"
#include "common/log.hpp"
#include "common/wire.hpp"
#include "daemon/record/record_folder.hpp"
#include "daemon/record/record_state.hpp"

namespace orbbuf {

/// Limits what is written to a disk to so many bytes a second on average: a write may begin while
/// less than one second's worth is ahead of that rate. Reentrant.
class WritePace {
 public:
  using Clock = std::chrono::steady_clock;

  /// bytes_per_s: 0 for no limit.
  explicit WritePace(std::uint64_t bytes_per_s) : bytes_per_s_(static_cast<double>(bytes_per_s)) {}

  /// When the next write may begin; not after `now` if it may at once.
  Clock::time_point next() const { return paid_at_ - kBurst; }
  void spend(std::uint64_t bytes, Clock::time_point now) {
    if (bytes_per_s_ == 0) return;
    const std::chrono::duration<double> time(static_cast<double>(bytes) / bytes_per_s_);
    paid_at_ = std::max(paid_at_, now) + std::chrono::ceil<Clock::duration>(time);
  }

 private:
  static constexpr std::chrono::seconds kBurst{1};

  const double bytes_per_s_;
  Clock::time_point paid_at_{};  // when the rate has covered all that was written
};

/// `buffer.drop_log` and `[spool]` of orbbufd.toml.
struct RecordSettings {
  std::filesystem::path path;                ///< empty: nothing is written
  bool keeps_frames = false;                 ///< with `spool.path`
  std::uint64_t size_bytes = 8ULL << 30;     ///< of all files; >= kMinBytes
  std::uint64_t rate_bytes_per_s = 4 << 20;  ///< of frames and items, at most; 0: no limit
  std::uint64_t least_free_bytes = 1 << 20;  ///< of the disk, left to accounts

  static constexpr std::uint64_t kMinBytes = 4 << 20;
  static constexpr std::uint64_t kBytesWithoutFrames = 256 << 20;
};

/// The robot's own record of its sessions, in a journal on its disk: how many frames were captured,
/// which of them were given up, and what the server has. After a crash or a power cut the next
/// start can say of each frame what became of it. With keeps_frames, the frames as well that the
/// live stream passed over, or sent reduced, until the server has them whole.
///
/// Thread-bound to `main`, which it never has wait for the disk: a thread `record` of its own
/// writes and syncs what is new after each note(), and reads ahead the frames that next() returns.
/// Items are taken not faster than the rate, and frames are written with what these leave of it. A
/// disk that is full or fails costs frames and samples, never the process: a full disk takes no new
/// ones, and keeps room for accounts; of one that fails the record tries again every 5 s. Without a
/// path it writes nothing, and holds no frames.
///
/// The journal is a ring: its oldest segment is removed when no frame in it is held and two newer
/// ones have the accounts, or, which costs the frames in it, when the files are as large as they
/// may be, or the disk is full.
///
/// Memory: kMostPendingBytes, the frames read ahead, 24 bytes for each frame held, and for each
/// session that the server has not settled some 300 bytes and its drop records (DropRanges).
class Record {
 public:
  static constexpr std::size_t kMostPendingBytes = 16 << 20;
  static constexpr std::size_t kReadAhead = 2;  // frames
  static constexpr std::uint64_t kSegmentBytes = 1 << 20;
  static constexpr std::uint64_t kFrameSegmentBytes = 16 << 20;

  static constexpr std::size_t kMostPendingItemBytes = 4 << 20;

  struct LateFrame {
    KeptId id;
    std::string session_id;
    FramePtr frame;  ///< null: items
    wire::Items items{};
  };

  struct Stats {
    std::uint64_t held = 0;      ///< frames
    std::uint64_t bytes = 0;     ///< of the files, and of what waits to be written
    std::uint64_t evicted = 0;   ///< since the start: frames lost because of the limit in bytes
    std::uint64_t not_kept = 0;  ///< since the start: frames that the disk did not take
    std::uint64_t damaged = 0;   ///< since the start: frames that could not be read back

    friend bool operator==(const Stats&, const Stats&) = default;
  };

  /// Makes the folder if it is absent, and reads what is in it. The ids are valid ones. Throws
  /// std::runtime_error if another process uses the folder. That it cannot write there is logged,
  /// and then it keeps nothing.
  ///
  /// `changed` is called on the record's thread when next() may return a frame after it returned
  /// none, or held frames were lost. It must not call back.
  Record(RecordSettings settings, const std::string& robot_id, const std::string& session_id,
         std::function<void()> changed);
  /// Writes what waits, without regard to the rate, and syncs. What a slow disk has not taken after
  /// 8 s is not written.
  ~Record();
  Record(const Record&) = delete;
  Record& operator=(const Record&) = delete;

  bool keeps_frames() const { return settings_.keeps_frames; }
  bool keeps_items() const { return writer_.has_value(); }

  // The present session.

  void give_up(std::span<const DropRecord> records);
  /// Items of a stream that wait for the server, written with the next note(): the next start sends
  /// them if that note() does not come that has them settled. False: they are not kept now, since
  /// they are too many for the rate or the disk.
  bool keep(const wire::Items& items);
  /// Of what was kept, those of these numbers do not wait any more: next() returns them. Returns
  /// how many of them the record has lost.
  std::uint64_t send_late(wire::StreamId stream, std::uint64_t begin, std::uint64_t end);
  /// Once a second; what is new is written then.
  void note(const SessionProgress& progress);
  /// Nothing more comes.
  void end();
  /// A whole frame, each at most once. If kMostPendingBytes wait for the disk, it is not kept.
  void keep(FramePtr frame);
  /// The server has a frame that may be kept, whole: it is not held any more.
  void release(Sequence sequence);
  /// Frames from `end` on may still be delivered live, and are not returned by next().
  void set_live_from(Sequence end);

  // Late frames, and items before them.

  /// The oldest frame that was not taken, if it is in memory; else `changed` says when.
  std::optional<LateFrame> next();
  /// next() is on its way to the server: the one after it is next. Requires a next().
  void take_next();
  /// The server has it, or it cannot be sent.
  void remove(const KeptId& id);

  // Accounts: RecordState.

  std::vector<wire::Account> take_accounts();
  void settle(const std::string& session_id);

  /// The connection broke: frames that were taken and not removed are next again, in order, and all
  /// accounts are to be taken again.
  void rewind();

  Stats stats() const;

 private:
  using Clock = std::chrono::steady_clock;
  using Lock = std::unique_lock<std::mutex>;

  bool open();

  // On the record's thread. Those with a lock release it while they use the disk; the others need
  // it released.
  void run(const std::stop_token& stop);
  bool work(Lock& lock, Clock::time_point now);
  Clock::time_point next_deadline(Clock::time_point now) const;
  bool write_notes(Lock& lock, Clock::time_point now);
  bool write_frame(Lock& lock, Clock::time_point now);
  bool sync(Lock& lock, Clock::time_point now);
  bool remove_oldest(Lock& lock);
  bool has_room_for(const RecordState::Note& items);
  void on_items_written(const RecordState::Note& note, const journal::Place& place);
  bool read_ahead(Lock& lock, Clock::time_point now);
  Result<std::optional<LateFrame>> read(const RecordState::Taken& taken) const;
  void check_folder();
  Result<journal::Place> append(std::uint8_t type, record_format::Bytes head,
                                record_format::Bytes rest);
  void begin_segment_next();
  void make_room(std::uint64_t bytes);
  void remove_segment(std::uint32_t segment, const std::string& why);
  void make_room_for(std::size_t note_bytes);
  bool has_free(std::uint64_t bytes) const;
  bool sync_files();
  void finish(Lock& lock);
  void fail(const Error& error);

  // These require mutex_.
  void wake();
  void pop_pending();
  void refuse_pending(const std::string& why);
  void refuse(const std::string& why);
  void report_lost(const std::vector<RecordState::Lost>& lost, const std::string& why);

  RecordSettings settings_;
  const std::string name_;  // of the present session
  const std::function<void()> changed_;
  const std::uint64_t segment_bytes_;

  // The record's thread only, and the constructor.
  RecordFolder folder_;
  std::optional<journal::Writer> writer_;
  record_format::Index index_;           // of the segment that is written
  std::uint64_t segment_end_ = 0;        // where it is complete; 0: a new one is next
  std::uint32_t synced_segment_ = 0;     // the newest of which the device has the checkpoint
  std::deque<RecordState::Note> notes_;  // to be written
  WritePace pace_;                       // of frames, which wait for what items have taken
  Clock::time_point sync_at_ = Clock::time_point::max();  // max: all is synced
  Clock::time_point retry_at_{};                          // nothing is written before
  Clock::time_point read_at_{};                           // nor read before this
  int failed_reads_ = 0;                                  // of the frame that is next

  mutable std::mutex mutex_;
  WritePace item_pace_;  // guarded by mutex_
  std::condition_variable_any woken_;
  RecordState state_;              // guarded by mutex_
  bool is_woken_ = false;          // guarded by mutex_
  bool is_note_due_ = false;       // guarded by mutex_
  bool is_changed_ = false;        // guarded by mutex_: changed_ is to be called
  bool is_failing_ = false;        // guarded by mutex_: the disk
  std::deque<FramePtr> pending_;   // guarded by mutex_
  std::size_t pending_bytes_ = 0;  // guarded by mutex_
  Sequence live_from_ = std::numeric_limits<Sequence>::max();  // guarded by mutex_
  std::deque<LateFrame> ready_;  // guarded by mutex_: taken of state_, for next()
  std::vector<KeptId> taken_;    // guarded by mutex_: by take_next()
  std::uint64_t rewinds_ = 0;    // guarded by mutex_
  Stats counts_;                 // guarded by mutex_; without held and bytes
  LogLimit refused_limit_;       // guarded by mutex_
  LogLimit damaged_limit_;       // guarded by mutex_
  LogLimit lost_limit_;          // guarded by mutex_
  std::jthread thread_;
};

}  // namespace orbbuf
