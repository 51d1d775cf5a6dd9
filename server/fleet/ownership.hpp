// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <variant>

#include "server/fleet/fleet_keys.hpp"
#include "server/fleet/key_store.hpp"
#include "server/fleet/position_recorder.hpp"

namespace orbbuf::fleet {

/// A session that is ours.
struct Owned {
  Claim claim;
  std::uint64_t epoch = 0;
  Segment segment;          ///< ours
  wire::Position recorded;  ///< all below it may have been acknowledged, by its owner of that time
};

/// A segment of a session in this server's folder.
struct OnDisk {
  Segment segment;
  wire::Position next;  ///< behind what it has
};

/// A new session that another server should have.
struct Foreign {
  std::string server;
};

/// Makes sessions ours, by one txn that compares the keys: of several servers that try,
/// one succeeds, and from then on no other can record a position. Thread-bound to `main`; must
/// outlive every run of the io_context.
///
/// A take-over's epoch is the time of day in ms, and above the one before. So also after the store
/// went back to an older state it is above all that were given out before: no two segments have one
/// folder, and a segment here that is newer than those in the store is one that it has forgotten.
class Ownership {
 public:
  using Answer = std::function<void(Result<std::variant<Owned, Foreign>>)>;
  /// The server that should have a session that is new; nothing: this one.
  using Better = std::function<std::optional<std::string>()>;

  /// The time since the Unix epoch.
  using WallClock = std::function<std::chrono::nanoseconds()>;

  Ownership(
      KeyStore& store, std::string server, std::string instance,
      WallClock now = [] { return std::chrono::system_clock::now().time_since_epoch(); })
      : store_(store),
        server_(std::move(server)),
        instance_(std::move(instance)),
        now_(std::move(now)) {}

  /// The session becomes ours, also from a server that lives: the robot is here. But not a new one
  /// for which `better` names another server. `latest`: of its segments here. Never answers from
  /// within the call.
  void async_acquire(SessionName session, std::optional<OnDisk> latest, Better better,
                     Answer answer);

  /// The robot has ended it, and all is recorded. Its keys go 30 days later, unless the robot goes
  /// on. Best effort: nothing depends on it.
  void end(const Owned& owned);

  std::uint64_t take_overs() const { return take_overs_; }

 private:
  struct Attempt {
    SessionName session;
    std::optional<OnDisk> latest;
    Better better;
    Answer answer;
    int left = 0;  // tries
  };

  void read(Attempt attempt);
  void decide(Attempt attempt, const KeyTxnOutcome& read);
  void note_end(const Owned& owned, std::int64_t lease, const KeyTxnOutcome& read);
  void write(Attempt attempt, const KeyTxnOutcome& read, const SessionOwner& owner);

  KeyStore& store_;
  const std::string server_;
  const std::string instance_;
  const WallClock now_;
  std::uint64_t take_overs_ = 0;
};

}  // namespace orbbuf::fleet
