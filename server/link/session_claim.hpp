// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>

#include "common/error.hpp"
#include "common/wire.hpp"
#include "server/session/earlier_frames.hpp"
#include "server/session/session_info.hpp"

namespace orbbuf {

using SessionKey = std::pair<std::string, std::string>;  ///< robot id, session id

/// What allows this server to acknowledge items of a session, where several servers may have it one
/// after the other. Thread-bound to `main`.
class SessionClaim {
 public:
  using Answer = std::function<void(bool is_ours)>;

  virtual ~SessionClaim() = default;

  /// Answers when all below `position` may be acknowledged; false: the session is another server's,
  /// so nothing may. One call is outstanding at a time. Never answers from within the call, and
  /// perhaps never.
  virtual void async_may_acknowledge(const wire::Position& position, Answer answer) = 0;
  /// The answer is waited for.
  virtual void hurry() = 0;
  /// The session is closed here. has_ended: nothing more of it will come.
  virtual void leave(bool has_ended) = 0;
  /// All below it may have been acknowledged before this claim began.
  virtual wire::Position acknowledged_before() const = 0;
};

/// Decides which server of several has a session. Thread-bound to `main`; must outlive every run of
/// the io_context.
class SessionClaims {
 public:
  struct Granted {
    std::shared_ptr<SessionClaim> claim;     ///< the same object, as long as no other server had it
    SegmentInfo segment;                     ///< the part of the session that is to be kept here
    std::shared_ptr<EarlierFrames> earlier;  ///< of the parts before it; null: there are none
  };
  struct Moved {
    std::string address;  ///< of the server that the robot should go to; empty: not known
  };
  using Outcome = Result<std::variant<Granted, Moved>>;

  virtual ~SessionClaims() = default;

  /// A robot says hello for that session. May answer from within the call.
  virtual void async_enter(const SessionKey& session, std::function<void(Outcome)> entered) = 0;
  /// The id of the session that is kept in the folder of this name.
  virtual std::string session_in(const std::string& folder) const = 0;
  /// Where robots can go; empty: nowhere.
  virtual std::string refuge() const = 0;
  /// This server cannot write what robots send: for a while others are to take them. `done` when
  /// the others know; an error if there is no other that takes robots.
  virtual void async_step_aside(std::function<void(const std::optional<Error>&)> done) = 0;
};

}  // namespace orbbuf
