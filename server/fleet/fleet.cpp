// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/fleet.hpp"

#include <algorithm>
#include <boost/asio/ip/host_name.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <iterator>
#include <memory>
#include <random>
#include <set>
#include <utility>

#include "common/file_io.hpp"
#include "common/log.hpp"

namespace orbbuf::fleet {
namespace {

constexpr std::chrono::milliseconds kLeavingInterval{200};

std::string make_instance() {
  std::random_device random;
  return fmt::format("{:08x}{:08x}", random(), random());
}

Error unanswered(const Error& error) { return {"the fleet's etcd does not answer: " + error.text}; }

/// Another process cannot have it: lock_folder() sees to that on this machine, and no other one has
/// its kernel's number. After a restart of the machine the old key's lease is over soon.
std::string place_of(const std::filesystem::path& folder) {
  std::error_code no_path;
  boost::system::error_code no_name;
  const auto boot = read_text("/proc/sys/kernel/random/boot_id");
  const std::string text = std::filesystem::weakly_canonical(folder, no_path).string() + '\n' +
                           boost::asio::ip::host_name(no_name) + '\n' + (boot ? boot.value() : "");
  return fmt::format("{:016x}", std::hash<std::string>{}(text));
}

ServerEntry entry_of(const FleetSettings& settings, const std::filesystem::path& folder) {
  return {settings.name, make_instance(), settings.address, settings.http, 0,
          false,         place_of(folder)};
}

}  // namespace

Fleet::Fleet(boost::asio::io_context& main, const FleetSettings& settings,
             const std::filesystem::path& folder, std::function<std::uint64_t()> robots)
    : main_(main),
      etcd_(main, {settings.etcd, settings.tls}),
      membership_(main, etcd_, entry_of(settings, folder), settings.lease, std::move(robots)),
      ownership_(etcd_, settings.name, membership_.self().instance),
      recorder_(main, etcd_),
      viewers_etcd_(main, {settings.etcd, settings.tls}),
      overview_(viewers_etcd_, settings.etcd) {}

void Fleet::start() {
  const ServerEntry& self = membership_.self();
  log_info("fleet: this is {}, for robots at {}", self.name, self.address);
  membership_.start();
}

void Fleet::async_stop(std::function<void()> stopped) {
  recorder_.stop();
  membership_.async_stop([this, stopped = std::move(stopped)] {
    etcd_.stop();
    viewers_etcd_.stop();
    stopped();
  });
}

void Fleet::async_enter(const SessionName& session, Entered entered) {
  if (!membership_.has_joined()) {
    return entered(unanswered({"this server has not joined the fleet yet"}));
  }
  if (is_draining()) return send_away(session, refuge_name(), entered);
  acquire(session, false, std::move(entered));
}

/// is_fresh: the servers were read just now.
void Fleet::acquire(const SessionName& session, bool is_fresh, Entered entered) {
  ownership_.async_acquire(
      session,
      [this, session] { return sent_away_.contains(session.text()) ? std::nullopt : better(); },
      [this, session, is_fresh, entered = std::move(entered)](const auto& answer) {
        if (!answer) return entered(unanswered(answer.error()));
        if (const auto* const owned = std::get_if<Owned>(&answer.value())) {
          sent_away_.erase(session.text());
          return entered(*owned);
        }
        const std::string& server = std::get<Foreign>(answer.value()).server;
        if (is_fresh) return send_away(session, server, entered);
        membership_.async_refresh([this, session, entered](const auto& error) {
          if (error) return entered(unanswered(*error));
          acquire(session, true, entered);
        });
      });
}

/// Robots that begin are spread; those that are here stay.
std::optional<std::string> Fleet::better() const {
  constexpr std::uint64_t kSlack = 4;
  const auto other = membership_.least_loaded_other();
  if (!other) return std::nullopt;
  const auto own = membership_.self().robots;
  if (own <= other->robots + std::max(kSlack, other->robots / 4)) return std::nullopt;
  return other->name;
}

void Fleet::send_away(const SessionName& session, const std::string& server,
                      const Entered& entered) {
  const auto found = membership_.servers().find(server);
  if (found == membership_.servers().end()) {
    return entered(Error{"fleet: no other server takes this session at the moment"});
  }
  const auto now = Clock::now();
  std::erase_if(sent_away_, [now](const auto& entry) { return now - entry.second > kInsistence; });
  sent_away_[session.text()] = now;
  entered(Moved{found->second.address});
}

void Fleet::async_drain(Membership::Done done) {
  membership_.async_refresh([this, done = std::move(done)](const auto& error) {
    if (error) return done(error);
    if (!membership_.least_loaded_other()) {
      return done(Error{"no other server of the fleet can take the robots"});
    }
    membership_.async_drain(done);
  });
}

void Fleet::async_leave(std::vector<SessionName> sessions,
                        std::function<void(Result<std::vector<SessionName>>)> done) {
  await_leaving(std::move(sessions), Clock::now() + kInsistence, std::move(done));
}

/// A request's worth at a time.
void Fleet::await_leaving(std::vector<SessionName> sessions, Clock::time_point limit,
                          std::function<void(Result<std::vector<SessionName>>)> done) {
  if (sessions.empty() || Clock::now() >= limit) return done(std::move(sessions));
  std::vector<KeyTxn> txns;
  for (const SessionName& session : sessions) {
    if (txns.size() < KeyStore::kMostTxns) txns.push_back({{}, {}, {session.owner_key()}});
  }
  etcd_.async_txns(std::move(txns), [this, sessions = std::move(sessions), limit,
                                     done = std::move(done)](const auto& outcomes) mutable {
    if (!outcomes) return done(outcomes.error());
    std::set<std::string> ours;
    for (const KeyTxnOutcome& outcome : outcomes.value()) {
      const auto owner =
          outcome.found.empty() ? std::nullopt : owner_from(outcome.found.front().value);
      const bool is_ours = owner && owner->server == membership_.self().name && !owner->has_ended;
      if (is_ours) ours.insert(outcome.found.front().key);
    }
    const auto asked = sessions.begin() + static_cast<std::ptrdiff_t>(outcomes.value().size());
    sessions.erase(
        std::remove_if(sessions.begin(), asked,
                       [&](const auto& each) { return !ours.contains(each.owner_key()); }),
        asked);
    const auto timer = std::make_shared<boost::asio::steady_timer>(main_, kLeavingInterval);
    timer->async_wait([this, timer, sessions = std::move(sessions), limit,
                       done = std::move(done)](const auto& /*aborted*/) mutable {
      await_leaving(std::move(sessions), limit, std::move(done));
    });
  });
}

std::string Fleet::refuge() const {
  const auto other = membership_.least_loaded_other();
  return other ? other->address : std::string();
}

std::string Fleet::refuge_name() const {
  const auto other = membership_.least_loaded_other();
  return other ? other->name : std::string();
}

}  // namespace orbbuf::fleet
