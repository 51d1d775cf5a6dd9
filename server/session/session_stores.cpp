// SPDX-License-Identifier: Apache-2.0
#include "server/session/session_stores.hpp"

#include <algorithm>
#include <boost/asio/steady_timer.hpp>
#include <utility>

#include "common/byte_order.hpp"
#include "common/log.hpp"
#include "common/system_clock.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;

constexpr std::chrono::seconds kRetry{1};
constexpr std::chrono::hours kNaming{24};

}  // namespace

SessionStores::SessionStores(asio::io_context& main, asio::thread_pool& pool,
                             std::filesystem::path folder, Durability durability,
                             GroupCommit* commit)
    : main_(main),
      pool_(pool),
      folder_(std::move(folder)),
      durability_(durability),
      commit_(commit) {}

std::shared_ptr<SessionStores::Robot> SessionStores::robot(const std::string& robot_id) {
  auto& robot = robots_[robot_id];
  if (!robot) robot = std::make_shared<Robot>(asio::make_strand(pool_));
  return robot;
}

bool SessionStores::Robot::may_name() {
  const auto now = std::chrono::steady_clock::now();
  if (now >= begun + kNaming) {
    begun = now;
    count = named.size();
  }
  if (count >= kMostNamed) return false;
  ++count;
  return true;
}

std::shared_ptr<SharedStore> SessionStores::make(Robot& robot, const SessionInfo& info) {
  return std::make_shared<SharedStore>(main_, robot.strand, folder_, info, durability_, commit_);
}

/// For late frames and accounts.
std::shared_ptr<SharedStore> SessionStores::use(const std::string& robot_id, Robot& robot,
                                                const std::string& session_id) {
  Entry& entry = robot.entries[session_id];
  if (!entry.store) entry.store = make(robot, {robot_id, session_id, ""});
  entry.used_at = ++uses_;
  auto store = entry.store;
  close_idle(kMostIdle);
  return store;
}

std::shared_ptr<SharedStore> SessionStores::use(const std::string& robot_id,
                                                const std::string& session_id) {
  return use(robot_id, *robot(robot_id), session_id);
}

void SessionStores::async_open(const SessionInfo& info, std::function<void(Result<Opened>)> done) {
  const auto robot = this->robot(info.robot_id);
  Entry& entry = robot->entries[info.session_id];
  if (!entry.store) entry.store = make(*robot, info);
  entry.is_live = true;
  entry.store->run(
      [calibration = info.calibration](SessionStore& store) -> Result<wire::Position> {
        store.calibrate(calibration);
        return store.position();
      },
      [this, info, store = entry.store, done = std::move(done)](Result<wire::Position> position) {
        if (position) {
          watcher_(Event::kOpened, info.robot_id, info.session_id);
          return done(Opened{store, position.value()});
        }
        on_closed(info.robot_id, info.session_id);
        done(std::move(position).error());
      });
}

void SessionStores::on_closed(const std::string& robot_id, const std::string& session_id) {
  const auto robot = this->robot(robot_id);
  const auto entry = robot->entries.find(session_id);
  if (entry == robot->entries.end()) return;
  entry->second.is_live = false;
  if (robot->held.contains(session_id)) {
    close_idle(kMostIdle);
  } else {
    entry->second.store->close();
    robot->entries.erase(entry);
  }
  watcher_(Event::kClosed, robot_id, session_id);
}

void SessionStores::write(const std::string& robot_id, const std::string& session_id,
                          const std::shared_ptr<const Job>& job) {
  const auto robot = this->robot(robot_id);
  const auto store = use(robot_id, *robot, session_id);
  if (job->is_account) robot->entries[session_id].account = job;
  store->run([job](SessionStore& session) { return job->write(session); },
             [this, robot_id, session_id, robot, store, job](Result<Outcome> outcome) {
               if (!outcome) {
                 if (robot->failing.empty()) {
                   robot->failing = session_id;
                   log_error("{}: late frames paused: {}", robot_id, outcome.error().text);
                 }
                 return try_again(robot_id, session_id, job);
               }
               if (robot->failing == session_id && outcome.value() != Outcome::kNoStream) {
                 robot->failing.clear();
                 log_info("{}: late frames of session {} go on", robot_id, session_id);
               }
               on_written(robot_id, session_id, store, job, outcome.value());
             });
}

void SessionStores::on_written(const std::string& robot_id, const std::string& session_id,
                               const std::shared_ptr<SharedStore>& store,
                               const std::shared_ptr<const Job>& job, Outcome outcome) {
  const auto robot = this->robot(robot_id);
  if (outcome == Outcome::kNew) watcher_(Event::kLate, robot_id, session_id);
  if (outcome == Outcome::kRefused) {
    if (job->waiter.expired()) return;
    return job->kept(Error{"frames or an account of session " + session_id +
                           ", which is not known, or a number far beyond it"});
  }
  if (outcome == Outcome::kNoStream) {
    const auto entry = robot->entries.find(session_id);
    const bool is_account_due = entry != robot->entries.end() && !entry->second.account.expired();
    if (is_account_due) return try_again(robot_id, session_id, job);
    robot->unknown_samples += job->samples;
    if (robot->unknown.lets_through()) {
      log_warn("{}: late samples are not kept, of a stream that session {} has not; {} so far",
               robot_id, session_id, robot->unknown_samples);
    }
  }
  if (!job->waiter.expired()) job->written();
  store->async_commit([waiter = job->waiter, kept = job->kept,
                       is_new = outcome == Outcome::kNew](const auto& error) {
    if (!error && !waiter.expired()) kept(is_new);
  });
}

void SessionStores::try_again(const std::string& robot_id, const std::string& session_id,
                              const std::shared_ptr<const Job>& job) {
  const auto timer = std::make_shared<asio::steady_timer>(main_, kRetry);
  timer->async_wait([this, timer, robot_id, session_id, job](const error_code& failed) {
    if (failed) return;
    if (!job->waiter.expired()) return write(robot_id, session_id, job);
    const auto robot = this->robot(robot_id);
    if (robot->failing == session_id) robot->failing.clear();
  });
}

void SessionStores::write_late(const std::string& robot_id, wire::LateFrame late,
                               std::weak_ptr<void> waiter, Kept kept, Written written) {
  const auto robot = this->robot(robot_id);
  const auto known = robot->entries.find(late.session_id);
  const bool is_named = robot->named.contains(late.session_id) ||
                        (known != robot->entries.end() && known->second.is_live);
  const auto shared = std::make_shared<const wire::LateFrame>(std::move(late));
  const auto work = [shared, is_named,
                     arrived_ns = system_time_ns()](SessionStore& store) -> Result<Outcome> {
    const auto& [session_id, frame, items] = *shared;
    if (store.is_new() && !is_named) return Outcome::kRefused;
    if (items) {
      if (!store.has_stream(items->stream)) return Outcome::kNoStream;
      if (!can_follow(items->first, store.position()[items->stream])) return Outcome::kRefused;
      if (auto error = store.write_late(*items)) return std::move(*error);
      return Outcome::kNew;
    }
    if (!can_follow(frame.sequence, store.summary().known_end())) return Outcome::kRefused;
    const auto outcome = store.write_late(frame, arrived_ns);
    if (!outcome) return outcome.error();
    return outcome.value() == SessionStore::Late::kNew ? Outcome::kNew : Outcome::kKnown;
  };
  const std::uint64_t samples =
      shared->items ? wire::Reader(shared->items->payload).take<std::uint16_t>() : 0;
  write(robot_id, shared->session_id,
        std::make_shared<const Job>(
            Job{work, std::move(waiter), std::move(written), std::move(kept), false, samples}));
}

void SessionStores::take_account(const std::string& robot_id, wire::Account account,
                                 const std::weak_ptr<void>& waiter, Kept kept, Written written) {
  const auto robot = this->robot(robot_id);
  const std::string session_id = account.session_id;
  const auto known = robot->entries.find(session_id);
  const bool is_live = known != robot->entries.end() && known->second.is_live;
  const bool can_make = is_live || robot->named.contains(session_id) || robot->may_name();
  const bool is_held = account.is_held();
  if (can_make && !is_live) robot->named.insert(session_id);
  if (can_make && is_held) robot->held.insert(session_id);
  if (!is_held) robot->held.erase(session_id);
  const auto work = [account = std::move(account),
                     can_make](SessionStore& store) -> Result<Outcome> {
    if (store.is_new() && !can_make) return Outcome::kRefused;
    if (!can_follow(account.captured, store.summary().known_end())) return Outcome::kRefused;
    if (auto error = store.take_account(account)) return std::move(*error);
    return Outcome::kKnown;
  };
  auto settled = [robot, session_id, is_held, waiter,
                  kept = std::move(kept)](const Result<bool>& is_new) {
    const auto entry = robot->entries.find(session_id);
    const bool is_open = entry != robot->entries.end();
    const bool is_over = !is_held && !(is_open && entry->second.is_live);
    if (is_over) robot->named.erase(session_id);
    if (!is_over || !is_open) return kept(is_new);
    const auto store = entry->second.store;
    robot->entries.erase(entry);
    store->close([waiter, kept, is_new] {
      if (!waiter.expired()) kept(is_new);
    });
  };
  write(
      robot_id, session_id,
      std::make_shared<const Job>(Job{work, waiter, std::move(written), std::move(settled), true}));
}

bool SessionStores::is_expected(const std::string& robot_id, const std::string& session_id) const {
  const auto robot = robots_.find(robot_id);
  return robot != robots_.end() && robot->second->held.contains(session_id);
}

/// Those that were not used for longest.
void SessionStores::close_idle(std::size_t most) {
  using Found = std::pair<Robot*, std::map<std::string, Entry>::iterator>;
  std::vector<Found> idle;
  for (const auto& [robot_id, robot] : robots_) {
    for (auto entry = robot->entries.begin(); entry != robot->entries.end(); ++entry) {
      if (!entry->second.is_live) idle.emplace_back(robot.get(), entry);
    }
  }
  if (idle.size() <= most) return;
  std::ranges::sort(idle, {}, [](const Found& found) { return found.second->second.used_at; });
  idle.resize(idle.size() - most);
  for (const auto& [robot, entry] : idle) {
    entry->second.store->close();
    robot->entries.erase(entry);
  }
}

}  // namespace orbbuf
