// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "common/drop_record.hpp"
#include "common/unique_fd.hpp"
#include "common/wire.hpp"

namespace orbbuf {

/// How far a session has come, as the robot knows: the file SESSION.state of its own record.
struct SessionState {
  enum class Stage : std::uint8_t {
    kOpen,   ///< the process lives, or was killed: the rest is as it was a second before
    kEnded,  ///< in an orderly way, but the server lacks a part of the record
    kDone,   ///< no next start has to tell the server of it
  };

  Stage stage = Stage::kOpen;
  std::string robot_id;
  std::uint64_t captured = 0;             ///< frames; of an open session at least so many
  std::int64_t last_capture_time_ns = 0;  ///< not before 1970
  wire::Position confirmed;               ///< acknowledged by the server

  friend bool operator==(const SessionState&, const SessionState&) = default;
};

/// A header and a line, of the same length throughout a session.
std::string to_csv(const SessionState& state);
std::optional<SessionState> state_from_csv(std::string_view text);

/// The robot's own record of a session, in the folder `buffer.drop_log`: SESSION.csv has the drop
/// records as the server's drops.csv has them, SESSION.state how far the session has come. A thread
/// of its own writes, so that a slow disk delays nothing else. Errors are logged once and end the
/// record, not the stream. The files are synced every 10 s; a power cut may lose what is newer.
///
/// The folder keeps the newest sessions: kMostSessions, and kMostBytes of them. The file of drop
/// records of the present one ends at kMostBytes.
///
/// Thread-bound to `main`. Memory: at most kMostPending bytes wait for the disk.
class SessionLog {
 public:
  static constexpr std::size_t kMostSessions = 20;
  static constexpr std::uint64_t kMostBytes = 8U << 20;  // 350,000 drop records
  static constexpr std::size_t kMostPending = 1U << 20;

  /// `folder`: made if it is absent; empty for no record. The ids are valid ones.
  SessionLog(const std::filesystem::path& folder, std::string robot_id,
             const std::string& session_id);
  /// Writes what waits.
  ~SessionLog();
  SessionLog(const SessionLog&) = delete;
  SessionLog& operator=(const SessionLog&) = delete;

  void add(std::span<const DropRecord> records);
  void note(std::uint64_t captured, std::int64_t last_capture_time_ns,
            const wire::Position& confirmed);
  /// Nothing more comes. `complete`: the server has the whole record.
  void end(bool complete);

 private:
  void wake();
  void write_until_end(const std::stop_token& stop);
  bool write(std::string_view records, std::string_view state);
  void sync() const;
  void give_up(const std::string& attempt);

  std::filesystem::path path_;
  UniqueFd records_file_;
  UniqueFd state_file_;  // locked: the session is alive
  SessionState state_;
  std::uint64_t bytes_ = 0;  // of records, written or pending
  bool is_full_ = false;

  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::string pending_records_;  // guarded by mutex_
  std::string pending_state_;    // guarded by mutex_; empty: none
  std::jthread writer_;
};

/// A session of an earlier process that the server has not seen to its end.
struct EarlierSession {
  std::filesystem::path file;  ///< SESSION.csv
  std::string session_id;
  SessionState state;
  std::vector<DropRecord> records;  ///< all in the file
};

/// Those in `folder`, the oldest first. Sessions of a process that lives are not among them.
std::vector<EarlierSession> find_earlier_sessions(const std::filesystem::path& folder);

/// "session X ended with frames 7 to 9 and 2 drop records not confirmed by the server: see FILE";
/// empty if all is confirmed.
std::string describe(const EarlierSession& session);

/// The next start has nothing to tell of it.
void settle(const EarlierSession& session);

}  // namespace orbbuf
