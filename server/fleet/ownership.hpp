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
  wire::Position recorded;  ///< all below it may have been acknowledged, by whoever owned it then
};

/// A session of another server.
struct Foreign {
  std::string server;
};

/// Makes sessions ours, by one txn that compares the key's revision: of several servers that try,
/// one succeeds, and from then on no other can record a position. Thread-bound to `main`; must
/// outlive every run of the io_context.
class Ownership {
 public:
  using Answer = std::function<void(Result<std::variant<Owned, Foreign>>)>;
  struct Rules {
    /// Whether a session may be taken from that server: it is dead, or wants to be rid of it.
    std::function<bool(const std::string& server)> may_take;
    /// The server that should have a session that is new; nothing: this one.
    std::function<std::optional<std::string>()> better;
  };

  Ownership(KeyStore& store, std::string server, std::string instance)
      : store_(store), server_(std::move(server)), instance_(std::move(instance)) {}

  /// A new session becomes ours, and another server's if `rules` say so. Never answers from within
  /// the call.
  void async_acquire(SessionName session, Rules rules, Answer answer);

  /// The robot has ended it, and all is recorded. Best effort: nothing depends on it.
  void end(const Owned& owned);

  std::uint64_t take_overs() const { return take_overs_; }

 private:
  struct Attempt {
    SessionName session;
    Rules rules;
    Answer answer;
    int left = 0;  // tries
  };

  void read(Attempt attempt);
  void decide(Attempt attempt, const KeyTxnOutcome& read);
  void write(Attempt attempt, const KeyTxnOutcome& read, const SessionOwner& owner);

  KeyStore& store_;
  const std::string server_;
  const std::string instance_;
  std::uint64_t take_overs_ = 0;
};

}  // namespace orbbuf::fleet
