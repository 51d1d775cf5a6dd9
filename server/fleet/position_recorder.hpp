// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/wire.hpp"
#include "server/fleet/fleet_keys.hpp"
#include "server/fleet/key_store.hpp"

namespace orbbuf::fleet {

/// What a server may record by: what the session's key said when it became ours. Any take-over, our
/// own after a restart too, changes it, and what it says then it never said before. Not by its
/// revision, which a store that went back to an older state gives out again.
struct Claim {
  SessionName session;
  std::string owner;
  /// Of the last change of the position, for the recorder.
  std::shared_ptr<std::int64_t> revision = std::make_shared<std::int64_t>(0);
};

/// Records how far sessions are kept, which is what allows an acknowledgement: for all sessions
/// together one request at a time, begun every kInterval at most, or at once after hurry(). The
/// request compares each claim, so a server whose session another has taken over records nothing,
/// and the position's revision, so one that is carried out late, after it was sent again, does not
/// move the position back. While the store does not answer it tries on.
///
/// Thread-bound to `main`; must outlive every run of the io_context.
class PositionRecorder {
 public:
  /// False: the claim is no longer ours, so nothing was recorded, nor will be. Never from within
  /// the call. Not called after stop().
  using Recorded = std::function<void(bool is_ours)>;

  static constexpr std::chrono::milliseconds kInterval{200};

  PositionRecorder(boost::asio::io_context& main, KeyStore& store,
                   std::chrono::milliseconds interval = kInterval);

  /// One call of a claim at a time.
  void async_record(const Claim& claim, const wire::Position& position, Recorded recorded);
  /// What waits is begun as soon as the request before it is over.
  void hurry();
  void stop();

  std::uint64_t records() const { return records_; }      ///< positions recorded
  std::uint64_t requests() const { return requests_; }    ///< answered
  std::uint64_t conflicts() const { return conflicts_; }  ///< claims that were not ours any more
  std::chrono::nanoseconds time_spent() const { return time_spent_; }

 private:
  using Clock = std::chrono::steady_clock;
  struct Job {
    Claim claim;
    wire::Position position;
    Recorded recorded;
  };

  void schedule();
  void begin();
  void on_answer(const Result<std::vector<KeyTxnOutcome>>& answer);
  static std::optional<bool> decide(const Job& job, const KeyTxnOutcome& outcome);

  KeyStore& store_;
  const std::chrono::milliseconds interval_;
  boost::asio::steady_timer timer_;
  std::deque<Job> waiting_;
  std::deque<Job> sent_;  // not empty: a request is outstanding
  Clock::time_point begun_{};
  Clock::time_point next_{};  // not before that
  bool is_hurried_ = false;
  bool is_stopped_ = false;
  bool is_failing_ = false;  // logged
  std::uint64_t records_ = 0;
  std::uint64_t requests_ = 0;
  std::uint64_t conflicts_ = 0;
  std::chrono::nanoseconds time_spent_{};
};

}  // namespace orbbuf::fleet
