// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <boost/asio/io_context.hpp>
#include <boost/asio/strand.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "common/wire.hpp"
#include "server/recording/late_files.hpp"
#include "server/runtime/group_commit.hpp"

namespace orbbuf {

/// Takes the late frames of all robots to the folders of their sessions, and merges a session when
/// nothing more of it can come: it is not open, and the robot's last spool message does not have
/// it. docs/protocol.md, late frames; LateFiles and merge_late() say what is on disk.
///
/// Each robot's work is done in the pool, one job at a time, beside that of its live stream.
/// Thread-bound to `main`. Must outlive every run of the io_context.
class LateArrivals {
 public:
  /// The late frame is kept: it may be acknowledged. is_new: it was not there before. Runs on
  /// `main`, never from within the call.
  using Kept = std::function<void(bool is_new)>;
  using IsOpen = std::function<bool(const std::string& robot_id, const std::string& session_id)>;

  /// folder: files.path. commit: what is kept waits for it; null: for nothing. is_open: whether the
  /// session has a record that is being written.
  LateArrivals(boost::asio::io_context& main, boost::asio::thread_pool& pool,
               std::filesystem::path folder, GroupCommit* commit, IsOpen is_open);

  /// A frame that cannot be written is tried again every second, as long as `waiter` lives; it is
  /// logged once when that begins. `kept` does not run after the waiter's end.
  void write(const std::string& robot_id, wire::LateFrame late, std::weak_ptr<void> waiter,
             Kept kept);

  /// What the robot has still to send, of all its sessions.
  void on_spool(const std::string& robot_id, const wire::Spool& spool);

  /// The session's record is closed.
  void on_closed(const std::string& robot_id, const std::string& session_id);

  /// The server ends: no merge begins, and one that runs stops where it can be taken up again.
  void stop() { *is_stopping_ = true; }

  /// Whether the robot has said that it still has frames of the session.
  bool is_expected(const std::string& robot_id, const std::string& session_id) const;

  /// Whether the session is being merged, so that its record must not be opened now.
  bool is_merging(const std::string& robot_id, const std::string& session_id) const;

 private:
  struct Robot {
    explicit Robot(boost::asio::thread_pool& pool) : strand(boost::asio::make_strand(pool)) {}

    boost::asio::strand<boost::asio::thread_pool::executor_type> strand;
    std::map<std::string, std::shared_ptr<LateFiles>> files;  // by session; used in the strand only
    std::optional<wire::Spool> said;
    std::vector<wire::SpooledSession> noted;  // in the sessions' folders
    std::chrono::steady_clock::time_point noted_at;
    std::set<std::string> merging;  // sessions
    bool is_failing = false;
  };
  using RobotPtr = std::shared_ptr<Robot>;

  /// What is on disk of a session that may have to be merged.
  struct Leftover {
    std::string session_id;
    bool is_unmerged = false;
  };

  static constexpr std::chrono::seconds kNoteInterval{5};

  RobotPtr robot(const std::string& robot_id);
  std::shared_ptr<LateFiles> files(const std::string& robot_id, const RobotPtr& robot,
                                   const std::string& session_id);
  void try_to_write(const std::string& robot_id, const std::shared_ptr<const wire::LateFrame>& late,
                    std::weak_ptr<void> waiter, Kept kept);
  void commit(std::weak_ptr<void> waiter, Kept kept, bool is_new);
  void note(const std::string& robot_id, const RobotPtr& robot);
  void note(const std::string& robot_id, const RobotPtr& robot, const std::string& session_id,
            const wire::SpooledSession& session);
  void look_for_complete(const std::string& robot_id, const RobotPtr& robot);
  void merge(const std::string& robot_id, const RobotPtr& robot, const Leftover& leftover);
  static std::vector<Leftover> find_leftovers(const std::filesystem::path& folder);
  bool can_come(const std::string& robot_id, const Robot& robot,
                const std::string& session_id) const;

  boost::asio::io_context& main_;
  boost::asio::thread_pool& pool_;
  const std::filesystem::path folder_;
  GroupCommit* const commit_;
  const IsOpen is_open_;
  std::map<std::string, RobotPtr> robots_;
  bool has_commit_failed_ = false;  // what is written may not be there: nothing is merged
  const std::shared_ptr<std::atomic<bool>> is_stopping_ = std::make_shared<std::atomic<bool>>();
};

}  // namespace orbbuf
