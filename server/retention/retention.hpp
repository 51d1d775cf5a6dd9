// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "common/error.hpp"
#include "common/system_clock.hpp"
#include "server/retention/quota.hpp"
#include "server/retention/session_survey.hpp"

namespace orbbuf {

/// Decides whether a recording's age can be trusted, so that a clock that is set wrong removes
/// nothing. A clock that an NTP client keeps is trusted. Any other is not trusted for kQuarantine
/// after it has jumped: by more than kMostStep between two readings, or by more than kMostGap
/// between the last write before the first reading and that reading, as after a boot with a wrong
/// clock. chrony's `maxchange` is the model. Has no clock of its own; thread-bound.
class ClockTrust {
 public:
  static constexpr std::chrono::hours kMostGap{7 * 24};
  static constexpr std::chrono::hours kMostStep{1};
  static constexpr std::chrono::hours kQuarantine{24};

  /// last_write: of the newest recording.
  bool trusts(const SystemClockReading& now, std::chrono::system_clock::time_point last_write) {
    const bool has_jumped =
        last_ ? std::chrono::abs(now.wall - last_->wall - (now.since_boot - last_->since_boot)) >
                    kMostStep
              : now.wall - last_write > kMostGap;
    last_ = now;
    if (now.is_synchronised) {
      quarantine_end_ = {};
    } else if (has_jumped) {
      quarantine_end_ = now.since_boot + kQuarantine;
    }
    return now.since_boot >= quarantine_end_;
  }

 private:
  std::optional<SystemClockReading> last_;
  std::chrono::nanoseconds quarantine_end_{0};  // since boot
};

/// Removes a folder and all that is in it, following no link, until `deadline`, by and large. True:
/// it is gone; false: there is more of it. Blocking; reentrant.
Result<bool> remove_folder(const std::filesystem::path& folder,
                           std::chrono::steady_clock::time_point deadline);

/// Keeps each robot's sessions within a quota: looks what there is, at the start, every minute and
/// when it is woken, and removes what is finished and over it, the oldest first.
///
/// Nothing is removed by its age while the clock is not to be trusted (ClockTrust).
///
/// Finished: no session of this server's (`is_open`), and, since one from before its start might
/// still be continued, not the robot's newest one while its last write is not `session_timeout`
/// ago. That is decided, and the folder renamed, in one go on `main`, where robots are let into
/// their sessions; so no robot can come back to a session that is on its way out. What is read and
/// removed goes in steps of a few milliseconds through the `files` pool, behind the frames that
/// wait there, with pauses in between. A folder that was renamed when the server died is removed by
/// the next one.
///
/// Lives in a shared_ptr, which its steps hold. Thread-bound to `main`.
class Retention : public std::enable_shared_from_this<Retention> {
 public:
  using IsOpen = std::function<bool(const std::string& robot_id, const std::string& session_id)>;

  struct Options {
    std::filesystem::path path;  ///< sessions are PATH/ROBOT/SESSION
    Quota quota;
    std::chrono::nanoseconds session_timeout{0};
    std::chrono::nanoseconds interval = std::chrono::minutes(1);
    std::function<SystemClockReading()> read_clock = read_system_clock;
  };

  /// `main` and `pool` as in RecordSink.
  Retention(boost::asio::io_context& main, boost::asio::thread_pool& pool, Options options,
            IsOpen is_open);

  void start() { survey(true); }
  /// Looks at once: a disk is full, say. Does nothing while a pass is under way.
  void wake();
  /// Nothing more is begun, and no timer is left in `main`.
  void stop();

 private:
  void survey(bool is_new);
  void on_surveyed();
  Quota quota_in_force();
  bool is_finished(const KeptSession& session, bool is_newest) const;
  void remove_next();
  void set_aside(const KeptSession& session);
  void remove(const std::filesystem::path& folder);
  void fail(const Error& error);
  void pause_then(std::chrono::nanoseconds pause, std::function<void()> then);

  boost::asio::io_context& main_;
  boost::asio::thread_pool& pool_;
  const Options options_;
  const IsOpen is_open_;
  boost::asio::steady_timer timer_;
  ClockTrust clock_trust_;
  bool is_clock_trusted_ = true;
  SessionSurvey survey_;                     // of the step in the pool while there is one
  std::deque<KeptSession> going_;            // oldest first, robot by robot
  std::deque<std::filesystem::path> aside_;  // to be removed before the next of those
  std::set<std::string> failures_;           // logged already
  bool is_idle_ = false;                     // between two passes
  bool is_stopped_ = false;
};

}  // namespace orbbuf
