// SPDX-License-Identifier: Apache-2.0
#pragma once

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

/// A new session that another server should have.
struct Foreign {
  std::string server;
};

/// Makes sessions ours, by one txn that compares the key's revision: of several servers that try,
/// one succeeds, and from then on no other can record a position. Thread-bound to `main`; must
/// outlive every run of the io_context.
class Ownership {
 public:
  using Answer = std::function<void(Result<std::variant<Owned, Foreign>>)>;
  /// The server that should have a session that is new; nothing: this one.
  using Better = std::function<std::optional<std::string>()>;

  Ownership(KeyStore& store, std::string server, std::string instance)
      : store_(store), server_(std::move(server)), instance_(std::move(instance)) {}

  /// The session becomes ours, also from a server that lives: the robot is here. But not a new one
  /// for which `better` names another server. Never answers from within the call.
  void async_acquire(SessionName session, Better better, Answer answer);

  /// The robot has ended it, and all is recorded. Its keys go 30 days later, unless the robot goes
  /// on. Best effort: nothing depends on it.
  void end(const Owned& owned);

  std::uint64_t take_overs() const { return take_overs_; }

 private:
  struct Attempt {
    SessionName session;
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
  std::uint64_t take_overs_ = 0;
};

}  // namespace orbbuf::fleet
