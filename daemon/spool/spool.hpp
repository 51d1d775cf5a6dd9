// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "common/frame.hpp"
#include "common/log_limit.hpp"
#include "daemon/spool/segment.hpp"
#include "daemon/spool/segment_queue.hpp"
#include "daemon/spool/spool_folder.hpp"
#include "daemon/spool/write_pace.hpp"

namespace orbbuf {

/// `[spool]` of orbbufd.toml.
struct SpoolSettings {
  std::filesystem::path path;                ///< empty: no spool
  std::uint64_t size_bytes = 8ULL << 30;     ///< of all files; at least kMinBytes
  std::uint64_t rate_bytes_per_s = 4 << 20;  ///< the most written to the disk; 0: no limit

  static constexpr std::uint64_t kMinBytes = 4 << 20;
};

/// The frames that the live stream passed over, on the robot's disk until the server has them: of
/// this session, and of earlier ones of the same robot. A ring of files (segment.hpp): when it is
/// full, its oldest segment is lost.
///
/// Thread-bound to `main`, which it never has wait for the disk: a thread `spool` of its own writes
/// what add() brings, not faster than the rate, and reads ahead what next() hands out. After a kill
/// or a power cut, all frames of the last sync are found again; the files are synced every second.
/// Those acknowledged in the last second before it are handed out once more.
///
/// A disk that is full or fails costs frames, never the process: the spool tries again every 5 s.
///
/// Memory: kMostPendingBytes, the frames read ahead, 24 bytes for each record of the segments that
/// are written or read, and a few hundred bytes for each other segment.
class Spool {
 public:
  static constexpr std::size_t kMostPendingBytes = 16 << 20;
  static constexpr std::size_t kMostSessions = 500;
  static constexpr std::size_t kReadAhead = 2;  // frames

  /// The frames of one session that are here.
  struct Held {
    std::string session_id;
    std::uint64_t frames = 0;  ///< at least 1
    Sequence first = 0;        ///< the lowest number of them

    friend bool operator==(const Held&, const Held&) = default;
  };

  struct Stats {
    std::uint64_t frames = 0;       ///< held
    std::uint64_t bytes = 0;        ///< of the files, and of what waits to be written
    std::uint64_t evicted = 0;      ///< since the start: frames lost because the spool was full
    std::uint64_t not_spooled = 0;  ///< since the start: frames that the disk did not take
    std::uint64_t damaged = 0;      ///< since the start: frames that could not be read back

    friend bool operator==(const Stats&, const Stats&) = default;
  };

  /// Makes the folder if it is absent, and finds what is in it, which may take some seconds after a
  /// power cut. The ids are valid ones, settings.path is not empty. Throws std::runtime_error if
  /// the folder cannot be written or another process uses it.
  ///
  /// `changed` is called on the spool's thread when next() may hand out a frame after it handed out
  /// none, or held() may have changed other than by a call of this class. It must not call back.
  Spool(SpoolSettings settings, std::string robot_id, std::string session_id,
        std::function<void()> changed);
  /// Writes what waits, without regard to the rate, and syncs. What a slow disk has not taken after
  /// 8 s is not spooled.
  ~Spool();
  Spool(const Spool&) = delete;
  Spool& operator=(const Spool&) = delete;

  /// A frame of the present session, each at most once. If kMostPendingBytes wait for the disk, it
  /// is not spooled.
  void add(FramePtr frame);
  /// A frame of the present session that was added reached the server live: it is not held any
  /// more, and not handed out. Ignored if it is not here. If it was written long ago, held() counts
  /// it until the spool's thread has found it.
  void forget(Sequence sequence);

  /// The oldest frame that was not handed out yet, if it is in memory; else `changed` says when.
  std::optional<SpooledFrame> next();
  /// The oldest `frames` of those handed out are the server's.
  void acknowledge(std::uint64_t frames);
  /// The connection broke: those handed out and not acknowledged are handed out again, in order.
  void rewind();

  /// The sessions with frames here, oldest first, at most kMostSessions. Includes what waits to be
  /// written, and what is handed out. Takes time in proportion to the records of a segment.
  std::vector<Held> held() const;
  Stats stats() const;

 private:
  using Clock = std::chrono::steady_clock;
  using Lock = std::unique_lock<std::mutex>;

  // Called by the constructor.
  void find_segments();
  bool find_segment(std::uint64_t number, const SpoolCursor& cursor);

  // On the spool's thread. Those with a lock release it while they use the disk; the others need
  // it released.
  void run(const std::stop_token& stop);
  bool work(Lock& lock, Clock::time_point now);
  Clock::time_point next_deadline(Clock::time_point now) const;
  bool remove_finished(Lock& lock);
  bool load_index(Lock& lock);
  bool read_ahead(Lock& lock);
  bool write_cursor(Lock& lock, Clock::time_point now);
  bool sync(Lock& lock, Clock::time_point now);
  bool write_pending(Lock& lock, Clock::time_point now);
  Result<SegmentRecord> write(const EncodedFrame& frame);
  std::optional<Error> begin_segment(std::uint64_t record_bytes);
  void end_segment();
  void make_room(std::uint64_t bytes);
  void remove(std::uint64_t number);
  const SegmentReader* reader(std::uint64_t number);
  void finish(Lock& lock);
  void fail(const Error& error);

  // These require mutex_.
  void wake();
  void refuse(const std::string& why);
  void report_lost(const SegmentQueue::Lost& lost);
  void report_damaged(std::uint64_t frames, const std::string& why);
  void log_lost();

  const SpoolSettings settings_;
  const std::string robot_id_;
  const std::string session_id_;
  const std::function<void()> changed_;
  const std::uint64_t segment_bytes_;

  // The spool's thread only, and the constructor.
  SpoolFolder folder_;
  std::uint64_t next_number_ = 1;
  std::optional<SegmentWriter> writer_;
  std::optional<SegmentReader> reader_;
  WritePace pace_;
  SpoolCursor written_cursor_;
  Clock::time_point cursor_at_{};                         // not written before
  Clock::time_point sync_at_ = Clock::time_point::max();  // max: all is synced
  Clock::time_point retry_at_{};                          // nothing is written before
  bool is_changed_ = false;                               // changed_ is to be called

  mutable std::mutex mutex_;
  std::condition_variable_any woken_;
  bool is_woken_ = false;            // guarded by mutex_
  SegmentQueue queue_;               // guarded by mutex_
  std::deque<FramePtr> pending_;     // guarded by mutex_
  std::size_t pending_bytes_ = 0;    // guarded by mutex_
  bool is_writing_ = false;          // guarded by mutex_: pending_.front()
  bool is_write_forgotten_ = false;  // guarded by mutex_: that one
  bool is_failing_ = false;          // guarded by mutex_: the disk
  Stats counts_;                     // guarded by mutex_; without frames and bytes
  LogLimit refused_limit_;           // guarded by mutex_
  LogLimit damaged_limit_;           // guarded by mutex_
  LogLimit lost_limit_;              // guarded by mutex_
  SegmentQueue::Lost lost_;          // guarded by mutex_; not logged yet
  std::jthread thread_;
};

}  // namespace orbbuf
