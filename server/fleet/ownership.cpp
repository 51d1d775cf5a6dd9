// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/ownership.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <utility>
#include <vector>

namespace orbbuf::fleet {
namespace {

/// When others take it meanwhile, again and again.
constexpr int kAttempts = 5;
/// What has ended is forgotten after that.
constexpr std::chrono::hours kRemembered{30 * 24};

KeyTxn reading(const SessionName& session) {
  return {{}, {}, {session.owner_key(), session.position_key()}};
}

bool is_at_least(const wire::Position& position, const wire::Position& other) {
  for (wire::StreamId stream = 0; stream < wire::kMostStreams; ++stream) {
    if (position[stream] < other[stream]) return false;
  }
  return true;
}

wire::Position recorded_in(const KeyTxnOutcome& outcome, const SessionName& session) {
  const KeyValue* const value = outcome.find(session.position_key());
  const auto position = value != nullptr ? position_from(value->value) : std::nullopt;
  return position.value_or(wire::Position{});
}

}  // namespace

void Ownership::async_acquire(SessionName session, std::optional<OnDisk> latest, Better better,
                              Answer answer) {
  read({std::move(session), std::move(latest), std::move(better), std::move(answer), kAttempts});
}

void Ownership::read(Attempt attempt) {
  auto txn = reading(attempt.session);
  store_.async_txns({std::move(txn)},
                    [this, attempt = std::move(attempt)](const auto& outcomes) mutable {
                      if (!outcomes) return attempt.answer(outcomes.error());
                      decide(std::move(attempt), outcomes.value().front());
                    });
}

/// From the state in `read`: it is ours, it should be another's, or it becomes ours.
void Ownership::decide(Attempt attempt, const KeyTxnOutcome& read) {
  const KeyValue* const key = read.find(attempt.session.owner_key());
  const auto latest = attempt.latest;
  if (key == nullptr && !latest) {
    if (auto server = attempt.better()) return attempt.answer(Foreign{std::move(*server)});
    return write(std::move(attempt), read, {server_, instance_, 1, {{server_, 1, {}}}});
  }
  auto owner = key != nullptr ? owner_from(key->value)
                              : SessionOwner{server_, "", latest->segment.epoch, {latest->segment}};
  if (!owner) {
    return attempt.answer(Error{fmt::format("fleet: the key {} cannot be read", key->key)});
  }
  const wire::Position recorded = recorded_in(read, attempt.session);
  if (owner->server == server_ && owner->instance == instance_ && !owner->has_ended) {
    return attempt.answer(
        Owned{{attempt.session, key->value}, owner->epoch, owner->segments.back(), recorded});
  }
  const auto now = std::chrono::floor<std::chrono::milliseconds>(now_()).count();
  owner->epoch = std::max({owner->epoch + 1, latest ? latest->segment.epoch + 1 : 0,
                           static_cast<std::uint64_t>(std::max<std::int64_t>(now, 0))});
  if (latest && latest->segment.epoch > owner->segments.back().epoch &&
      is_at_least(latest->next, recorded)) {
    owner->segments.push_back(latest->segment);
  } else if (owner->server != server_) {
    // Of this server's files: an earlier process wrote them, and no other server has gone on since.
    owner->segments.push_back({server_, owner->epoch, recorded});
  }
  owner->server = server_;
  owner->instance = instance_;
  owner->has_ended = false;
  write(std::move(attempt), read, *owner);
}

/// The old owner can record until this is done. So the position is compared, too: our segment
/// begins exactly where the owner before has stopped to acknowledge.
void Ownership::write(Attempt attempt, const KeyTxnOutcome& read, const SessionOwner& owner) {
  KeyTxn txn = reading(attempt.session);
  for (const std::string& key : txn.reads) {
    const KeyValue* const value = read.find(key);
    txn.compare.push_back({key, value != nullptr ? value->mod_revision : 0});
  }
  // Both, since those of a session that has ended go with a lease.
  txn.puts = {{attempt.session.owner_key(), to_text(owner)},
              {attempt.session.position_key(), to_text(recorded_in(read, attempt.session))}};
  store_.async_txns(
      {std::move(txn)}, [this, attempt = std::move(attempt), owner](const auto& outcomes) mutable {
        if (!outcomes) return attempt.answer(outcomes.error());
        const KeyTxnOutcome& outcome = outcomes.value().front();
        if (!outcome.is_done) {  // or it was, and the answer was lost: then it is ours
          if (--attempt.left > 0) return decide(std::move(attempt), outcome);
          return attempt.answer(Error{"fleet: other servers want this session, too"});
        }
        if (owner.epoch > 1) ++take_overs_;
        attempt.answer(Owned{
            {attempt.session, to_text(owner), std::make_shared<std::int64_t>(outcome.revision)},
            owner.epoch,
            owner.segments.back(),
            recorded_in(outcome, attempt.session)});
      });
}

void Ownership::end(const Owned& owned) {
  store_.async_grant(kRemembered, [this, owned](const auto& lease) {
    if (!lease) return;
    store_.async_txns({reading(owned.claim.session)},
                      [this, owned, lease = lease.value()](const auto& outcomes) {
                        if (outcomes) note_end(owned, lease, outcomes.value().front());
                      });
  });
}

void Ownership::note_end(const Owned& owned, std::int64_t lease, const KeyTxnOutcome& read) {
  const SessionName& session = owned.claim.session;
  const KeyValue* const value = read.find(session.owner_key());
  auto owner = value != nullptr ? owner_from(value->value) : std::nullopt;
  if (!owner || value->value != owned.claim.owner) return;
  owner->has_ended = true;
  KeyTxn txn;
  txn.compare = {{session.owner_key(), 0, owned.claim.owner}};
  txn.puts = {{session.owner_key(), to_text(*owner), lease},
              {session.position_key(), to_text(recorded_in(read, session)), lease}};
  store_.async_txns({std::move(txn)}, [](const auto& /*outcomes*/) {});
}

}  // namespace orbbuf::fleet
