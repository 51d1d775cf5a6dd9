// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <utility>

#include "common/error.hpp"
#include "common/log.hpp"
#include "server/dataset/mcap/part.hpp"
#include "server/session/session_stores.hpp"

namespace orbbuf {

/// Makes the MCAP recordings of all sessions, part by part, behind what is written to them: one
/// part at a time, in steps of about a megabyte through the `files` pool, so that a frame waits for
/// one step at most. A part that fails, or that the end of the server has interrupted, is made
/// again.
///
/// Thread-bound to `main`. Must outlive every run of the io_context.
class RecordingParts {
 public:
  using Key = std::pair<std::string, std::string>;  // robot id, session id

  struct Options {
    std::filesystem::path path;  ///< sessions are PATH/ROBOT/SESSION
    /// Of a part. 0: a session's live frames are one part.
    std::chrono::nanoseconds split = std::chrono::minutes(5);
    /// The images of a part are removed once it is on the device.
    bool are_only_copies = false;
  };

  /// All must outlive the object; the pool is stopped before `main` is destroyed.
  RecordingParts(boost::asio::io_context& main, boost::asio::thread_pool& pool,
                 SessionStores& stores, Options options);

  /// Looks for what an earlier server has not recorded any more, and watches `stores` from here on.
  void start();

  /// All that is left becomes a part, and then `stopped` runs, possibly from within the call.
  void stop(std::function<void()> stopped);

 private:
  using Clock = std::chrono::steady_clock;
  using Maker = std::shared_ptr<std::optional<mcap::PartMaker>>;

  /// From then on a session is recorded also if this server dies before its first part.
  static constexpr std::chrono::milliseconds kMarkAfter{250};
  static constexpr std::chrono::minutes kLatePatience{5};
  static constexpr std::chrono::minutes kRetry{1};

  void on_event(SessionStores::Event event, const Key& session);
  void finish(const Key& session);
  void look_at(std::vector<Key> sessions);
  void schedule();
  Clock::time_point next_part() const;
  void make(const Key& session);
  void step(const Key& session, const Maker& maker);
  void note(const Key& session, const Maker& maker);
  void remove(const Key& session, const RecordedPart& part);
  void fail(const Key& session, const Error& error);
  void go_on();

  boost::asio::io_context& main_;
  boost::asio::thread_pool& pool_;
  SessionStores& stores_;
  const Options options_;
  boost::asio::steady_timer timer_;
  std::map<Key, Clock::time_point> due_;
  std::set<Key> live_;
  bool is_busy_ = false;
  std::function<void()> stopped_;  // set: stopping
  LogLimit failures_{std::chrono::minutes{1}};
};

}  // namespace orbbuf
