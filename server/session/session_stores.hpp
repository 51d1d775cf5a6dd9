// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <string>

#include "common/error.hpp"
#include "common/log.hpp"
#include "common/wire.hpp"
#include "server/runtime/group_commit.hpp"
#include "server/session/durability.hpp"
#include "server/session/session_info.hpp"
#include "server/session/shared_store.hpp"

namespace orbbuf {

/// The sessions on disk that are in use, each with one store: its live stream writes to it, and so
/// do late frames and accounts, which may come during a later session of the robot.
///
/// A session is known if it is open, has a folder, or an account of the robot names it. At most
/// kMostIdle stores are open without a live stream; of the others the one that was not used for
/// longest is closed.
///
/// Thread-bound to `main`. Must outlive every run of the io_context.
class SessionStores {
 public:
  static constexpr std::size_t kMostIdle = 64;
  /// Sessions without a live stream that accounts of one robot name in a day: as many as a robot's
  /// record has. Each may make a folder.
  static constexpr std::size_t kMostNamed = 10'000;

  /// What a robot has sent is kept: it may be acknowledged. An error: the robot must not send that.
  /// Runs on `main`, never from within the call.
  using Kept = std::function<void(Result<bool> is_new)>;
  /// It is written, but a power cut can still take it. Runs on `main`, before Kept.
  using Written = std::function<void()>;

  struct Opened {
    std::shared_ptr<SharedStore> store;
    wire::Position position;
  };

  /// folder: files.path. commit: see SharedStore.
  SessionStores(boost::asio::io_context& main, boost::asio::thread_pool& pool,
                std::filesystem::path folder, Durability durability, GroupCommit* commit);

  enum class Event : std::uint8_t {
    kOpened,  ///< the live stream begins
    kLate,    ///< a late frame was kept that was not there
    kClosed,  ///< the live stream is over, or interrupted
  };
  using Watcher = std::function<void(Event, const std::string& robot_id, const std::string&)>;
  /// For work behind the streams. `watcher` runs on `main`, with a session's id.
  void watch(Watcher watcher) { watcher_ = std::move(watcher); }
  /// The store of any session that has a folder or is open.
  std::shared_ptr<SharedStore> use(const std::string& robot_id, const std::string& session_id);

  /// For the session's live stream, until on_closed().
  void async_open(const SessionInfo& info, std::function<void(Result<Opened>)> done);
  void on_closed(const std::string& robot_id, const std::string& session_id);

  /// A frame, or samples, that cannot be written is tried again every second, as long as `waiter`
  /// lives; its begin and end are logged. `kept` and `written` do not run after its end. Samples of
  /// a stream that the session has not wait while its account cannot be written. Else they are
  /// counted and logged, and are not new.
  void write_late(
      const std::string& robot_id, wire::LateFrame late, std::weak_ptr<void> waiter, Kept kept,
      Written written = [] {});
  /// What the robot knows of one of its sessions; is_new has no meaning.
  void take_account(
      const std::string& robot_id, wire::Account account, const std::weak_ptr<void>& waiter,
      Kept kept, Written written = [] {});

  /// Whether the robot has said that it still has frames of the session.
  bool is_expected(const std::string& robot_id, const std::string& session_id) const;

  /// The server ends: sessions without a live stream are closed.
  void stop() { close_idle(0); }

 private:
  struct Entry {
    std::shared_ptr<SharedStore> store;
    bool is_live = false;
    std::uint64_t used_at = 0;
    std::weak_ptr<const void> account;  // one that is being written, again and again perhaps
  };
  struct Robot {
    explicit Robot(PoolStrand of_all) : strand(std::move(of_all)) {}

    PoolStrand strand;
    std::map<std::string, Entry> entries;  // by session
    std::set<std::string> named;           // sessions that accounts name, without a live stream
    std::set<std::string> held;            // of these the robot has frames
    std::string failing;                   // one whose late frames cannot be written; logged
    std::uint64_t unknown_samples = 0;     // late ones, of streams that their session has not
    LogLimit unknown{std::chrono::seconds{10}};
    std::size_t count = 0;  // of `named`, with those that are over, in the day that begun
    std::chrono::steady_clock::time_point begun = std::chrono::steady_clock::now();

    /// Counts one more; false: it is not to be.
    bool may_name();
  };
  enum class Outcome : std::uint8_t { kNew, kKnown, kRefused, kNoStream };
  using Write = std::function<Result<Outcome>(SessionStore&)>;
  struct Job {
    Write write;
    std::weak_ptr<void> waiter;
    Written written;
    Kept kept;
    bool is_account = false;
    std::uint64_t samples = 0;
  };

  std::shared_ptr<SharedStore> make(Robot& robot, const SessionInfo& info);
  std::shared_ptr<Robot> robot(const std::string& robot_id);
  std::shared_ptr<SharedStore> use(const std::string& robot_id, Robot& robot,
                                   const std::string& session_id);
  void write(const std::string& robot_id, const std::string& session_id,
             const std::shared_ptr<const Job>& job);
  void on_written(const std::string& robot_id, const std::string& session_id,
                  const std::shared_ptr<SharedStore>& store, const std::shared_ptr<const Job>& job,
                  Outcome outcome);
  void try_again(const std::string& robot_id, const std::string& session_id,
                 const std::shared_ptr<const Job>& job);
  void close_idle(std::size_t most);

  boost::asio::io_context& main_;
  boost::asio::thread_pool& pool_;
  const std::filesystem::path folder_;
  const Durability durability_;
  GroupCommit* const commit_;
  Watcher watcher_ = [](Event /*event*/, const auto& /*robot_id*/, const auto& /*session_id*/) {};
  std::map<std::string, std::shared_ptr<Robot>> robots_;
  std::uint64_t uses_ = 0;
};

}  // namespace orbbuf
