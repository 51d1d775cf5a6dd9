// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/membership.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "common/log.hpp"

namespace orbbuf::fleet {
namespace {

constexpr std::chrono::seconds kFarewell{1};  // an etcd that is silent must not hold up the end

}  // namespace

Membership::Membership(boost::asio::io_context& main, KeyStore& store, ServerEntry self,
                       std::chrono::seconds lease, std::function<std::uint64_t()> robots)
    : store_(store),
      self_(std::move(self)),
      ttl_(lease),
      robots_(std::move(robots)),
      timer_(main) {}

void Membership::beat() {
  self_.robots = robots_();
  self_.is_draining = std::chrono::steady_clock::now() < drain_end_;
  if (lease_ == 0) return join();
  store_.async_keep_alive(lease_, [this](const Result<bool>& alive) {
    if (is_stopped_) return;
    if (!alive) return beat_later(alive.error());
    if (alive.value()) return keep();
    log_warn("fleet: this server's lease has run out; others may have taken its sessions");
    lease_ = 0;
    join();
  });
}

void Membership::join() {
  store_.async_grant(ttl_, [this](const Result<std::int64_t>& lease) {
    if (is_stopped_) return;
    if (!lease) return beat_later(lease.error());
    lease_ = lease.value();
    revision_ = 0;  // the key went with the lease before
    written_.reset();
    keep();
  });
}

void Membership::keep() {
  const auto refresh = [this](const std::optional<Error>& error) {
    if (is_stopped_) return;
    if (error) return beat_later(error);
    async_refresh([this](const std::optional<Error>& failed) { beat_later(failed); });
  };
  if (written_ == self_) return refresh(std::nullopt);
  write(refresh);
}

void Membership::write(Done done) {
  KeyTxn txn;
  txn.compare = {{self_.key(), revision_}};
  txn.puts = {{self_.key(), to_text(self_), lease_}};
  txn.reads = {self_.key()};
  store_.async_txns({std::move(txn)},
                    [this, entry = self_, done = std::move(done)](const auto& outcomes) {
                      if (!outcomes) return done(outcomes.error());
                      const KeyTxnOutcome& outcome = outcomes.value().front();
                      if (!outcome.is_done) return on_refused(outcome, done);
                      if (!written_) log_info("fleet: {} has joined", entry.name);
                      written_ = entry;
                      revision_ = outcome.revision;
                      has_ever_joined_ = true;
                      doubled_since_.reset();
                      done(std::nullopt);
                    });
}

/// The key is gone with its lease, or this server's from an earlier start, or another's.
void Membership::on_refused(const KeyTxnOutcome& outcome, const Done& done) {
  const auto other = outcome.found.empty()
                         ? std::nullopt
                         : server_from(outcome.found.front().key, outcome.found.front().value);
  if (!other || (!other->place.empty() && other->place == self_.place)) {
    revision_ = outcome.found.empty() ? 0 : outcome.found.front().mod_revision;
    return write(done);
  }
  written_.reset();
  const Error error{
      fmt::format("fleet.name: another server of the fleet, {}, has the name {}, too; give this "
                  "one another name",
                  other->address, self_.name)};
  const auto now = std::chrono::steady_clock::now();
  if (!doubled_since_) doubled_since_ = now;
  if (!has_ever_joined_ && now >= *doubled_since_ + 2 * ttl_) throw std::runtime_error(error.text);
  done(error);
}

void Membership::beat_later(const std::optional<Error>& error) {
  if (is_stopped_) return;
  if (error && !std::exchange(is_failing_, true)) {
    log_error("fleet: {}; new sessions wait", error->text);
  }
  if (!error && std::exchange(is_failing_, false)) log_info("fleet: in touch with etcd again");
  timer_.expires_after(std::chrono::milliseconds(ttl_) / 3);
  timer_.async_wait([this](const boost::system::error_code& aborted) {
    if (!aborted && !is_stopped_) beat();
  });
}

void Membership::async_refresh(Done done) {
  store_.async_range(KeyRange(kServers), [this, done = std::move(done)](const auto& found) {
    if (!found) return done(found.error());
    servers_.clear();
    for (const KeyValue& key : found.value()) {
      if (auto server = server_from(key.key, key.value)) servers_[server->name] = *server;
    }
    const auto own = servers_.find(self_.name);
    if (own != servers_.end() && own->second.instance != self_.instance) written_.reset();
    done(std::nullopt);
  });
}

void Membership::async_drain(std::chrono::steady_clock::time_point end, Done done) {
  self_.is_draining = true;
  drain_end_ = std::max(drain_end_, end);
  write(std::move(done));
}

void Membership::async_stop(std::function<void()> stopped) {
  is_stopped_ = true;
  timer_.cancel();
  if (lease_ == 0) return stopped();
  timer_.expires_after(kFarewell);
  timer_.async_wait([stopped = std::move(stopped)](const auto& /*over*/) { stopped(); });
  store_.async_revoke(lease_, [this](const auto& /*done*/) { timer_.cancel(); });
}

std::optional<ServerEntry> Membership::least_loaded_other() const {
  std::optional<ServerEntry> best;
  for (const auto& [name, server] : servers_) {
    if (name == self_.name || server.is_draining) continue;
    if (!best || server.robots < best->robots) best = server;
  }
  return best;
}

}  // namespace orbbuf::fleet
