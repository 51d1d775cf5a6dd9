// SPDX-License-Identifier: Apache-2.0
#include "server/fleet/fleet.hpp"

#include <fmt/core.h>
#include <sys/stat.h>

#include <algorithm>
#include <boost/asio/ip/host_name.hpp>
#include <boost/asio/steady_timer.hpp>
#include <iterator>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <string_view>
#include <utility>

#include "common/file_io.hpp"
#include "common/log.hpp"
#include "common/seconds.hpp"
#include "server/fleet/earlier_segments.hpp"
#include "server/fleet/fleet_keys.hpp"
#include "server/runtime/run_in_pool.hpp"
#include "server/session/session_reader.hpp"

namespace orbbuf::fleet {
namespace {

constexpr std::chrono::milliseconds kLeavingInterval{200};

std::string make_instance() {
  std::random_device random;
  const auto high = random(), low = random();
  return fmt::format("{:08x}{:08x}", high, low);
}

Error unanswered(const Error& error) { return {"the fleet's etcd does not answer: " + error.text}; }

/// Another process cannot have it: lock_folder() sees to that on this machine, and no other one has
/// its kernel's number. Containers may have one path and one name for folders that are not the
/// same. After a restart of the machine the old key's lease is over soon.
std::string place_of(const std::filesystem::path& folder) {
  std::error_code no_path;
  boost::system::error_code no_name;
  const auto boot = read_text("/proc/sys/kernel/random/boot_id");
  struct stat status {};
  ::stat(folder.c_str(), &status);
  const std::string text = fmt::format(
      "{}\n{}\n{}\n{} {}", std::filesystem::weakly_canonical(folder, no_path).string(),
      boost::asio::ip::host_name(no_name), boot ? boot.value() : "", status.st_dev, status.st_ino);
  return fmt::format("{:016x}", std::hash<std::string>{}(text));
}

ServerEntry entry_of(const FleetSettings& settings, const std::filesystem::path& folder) {
  return {settings.name, make_instance(), settings.address, settings.http, 0,
          false,         place_of(folder)};
}

/// The newest segment of the session here; blocking.
std::optional<OnDisk> latest_on_disk(const std::filesystem::path& files, const std::string& server,
                                     const SessionKey& session) {
  std::error_code none;
  std::optional<OnDisk> latest;
  for (std::filesystem::directory_iterator entry(files / session.first, none);
       !none && entry != std::filesystem::directory_iterator(); entry.increment(none)) {
    const auto [session_id, epoch] = parse_folder(entry->path().filename().string());
    if (session_id != session.second || (latest && epoch < latest->segment.epoch)) continue;
    const auto summary = read_summary(entry->path());
    if (!summary) continue;
    latest = OnDisk{{server, epoch, summary->info.segment.from}, summary->position};
  }
  return latest;
}

void add(std::string& text, std::string_view name, std::string_view help, double value) {
  const bool is_counter = name.ends_with("_total");
  text += fmt::format(
      "# HELP orbbuf_fleet_{0} {1}\n# TYPE orbbuf_fleet_{0} {2}\norbbuf_fleet_{0} {3}\n", name,
      help, is_counter ? "counter" : "gauge", value);
}

}  // namespace

using nlohmann::json;

void Overview::async_page(const std::string& from, const Done& done) {
  const auto now = Clock::now();
  std::erase_if(pages_, [now](const auto& entry) {
    return entry.second.read_at && now - *entry.second.read_at >= kFresh;
  });
  const auto first = session_of(std::string(kSessions) + from) ? from : std::string();
  Page& page = pages_[first];
  if (page.read_at) return done(page.json);
  page.waiting.push_back(done);
  if (page.waiting.size() == 1) read(first);
}

void Overview::read(const std::string& from) {
  const auto get = [this, from](std::string_view prefix, std::size_t most, auto use) {
    const KeyRange range(prefix, most == 0 ? "" : from, most);
    store_.async_range(range, [this, from, use = std::move(use)](Result<Keys> found) {
      if (!found) return finish(from, found.error());
      use(std::move(found).value());
    });
  };
  get(kServers, 0, [this, from, get](const Keys& servers) {
    get(kSessions, kPage + 1, [this, from, get, servers](const Keys& owners) {
      get(kPositions, kPage + 1, [this, from, servers, owners](const Keys& positions) {
        finish(from, to_json(servers, owners, positions));
      });
    });
  });
}

void Overview::finish(const std::string& from, const Result<std::string>& text) {
  auto page = std::move(pages_.extract(from).mapped());
  const auto waiting = std::exchange(page.waiting, {});
  if (text) {
    page.json = text.value();
    page.read_at = Clock::now();
    pages_.emplace(from, std::move(page));
  }
  for (const Done& done : waiting) done(text);
}

std::string Overview::to_json(const Keys& servers, Keys owners, const Keys& positions) const {
  json page{{"etcd", json::array()}, {"servers", json::array()}, {"sessions", json::array()}};
  for (const Address& endpoint : etcd_) page["etcd"].push_back(to_string(endpoint));
  for (const KeyValue& key : servers) {
    const auto server = server_from(key.key, key.value);
    if (!server) continue;
    json& entry = page["servers"].emplace_back(json::parse(to_text(*server)));
    entry["name"] = server->name;
    entry.erase("place");
  }
  if (owners.size() > kPage) {
    if (const auto next = session_of(owners.back().key)) page["next"] = next->text();
    owners.pop_back();
  }
  std::map<std::string, const std::string*> position_of;
  for (const KeyValue& key : positions) position_of[key.key] = &key.value;
  for (const KeyValue& key : owners) {
    const auto name = session_of(key.key);
    const auto owner = owner_from(key.value);
    if (!name || !owner) continue;
    json& entry = page["sessions"].emplace_back(json::parse(to_text(*owner)));
    entry["robot"] = name->robot_id;
    entry["session"] = name->session_id;
    const auto found = position_of.find(name->position_key());
    const auto position = found == position_of.end() ? std::nullopt : position_from(*found->second);
    if (position) entry.update(json::parse(to_text(*position)));
  }
  return page.dump();
}

class Fleet::OwnClaim final : public SessionClaim {
 public:
  OwnClaim(Fleet& fleet, Owned owned) : fleet_(fleet), owned_(std::move(owned)) {}

  void async_may_acknowledge(const wire::Position& position, Answer answer) override {
    fleet_.recorder_.async_record(owned_.claim, position, std::move(answer));
  }
  void hurry() override { fleet_.recorder_.hurry(); }
  void leave(bool has_ended) override {
    if (has_ended) fleet_.ownership_.end(owned_);
  }
  wire::Position acknowledged_before() const override { return owned_.recorded; }
  const std::string& owner() const { return owned_.claim.owner; }

 private:
  Fleet& fleet_;
  const Owned owned_;
};

Fleet::Fleet(boost::asio::io_context& main, boost::asio::thread_pool& files,
             const FleetSettings& settings, std::filesystem::path folder,
             std::function<std::uint64_t()> robots)
    : main_(main),
      files_(files),
      folder_(std::move(folder)),
      etcd_(main, {settings.etcd, settings.tls}),
      membership_(main, etcd_, entry_of(settings, folder_), settings.lease, std::move(robots)),
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

void Fleet::async_enter(const SessionKey& key, Entered entered) {
  if (parse_folder(key.second).epoch > 1) {
    return entered(Error{key.second + " is the name of a later part of a session"});
  }
  run_in_pool(
      main_, files_,
      [folder = folder_, server = membership_.self().name, key] {
        return latest_on_disk(folder, server, key);
      },
      [this, session = SessionName{key.first, key.second},
       entered = std::move(entered)](const std::optional<OnDisk>& latest) {
        if (!membership_.has_joined()) {
          return entered(unanswered({"this server has not joined the fleet yet"}));
        }
        if (!membership_.self().is_draining) return acquire(session, latest, false, entered);
        const auto other = membership_.least_loaded_other();
        send_away(session, other ? other->name : "", entered);
      });
}

/// is_fresh: the servers were read just now.
void Fleet::acquire(const SessionName& session, const std::optional<OnDisk>& latest, bool is_fresh,
                    Entered entered) {
  ownership_.async_acquire(
      session, latest,
      [this, session] { return sent_away_.contains(session.text()) ? std::nullopt : better(); },
      [this, session, latest, is_fresh, entered = std::move(entered)](const auto& answer) {
        if (!answer) return entered(unanswered(answer.error()));
        if (const auto* const owned = std::get_if<Owned>(&answer.value())) {
          sent_away_.erase(session.text());
          return entered(grant(session, *owned));
        }
        const std::string& server = std::get<Foreign>(answer.value()).server;
        if (is_fresh) return send_away(session, server, entered);
        membership_.async_refresh([this, session, latest, entered](const auto& error) {
          if (error) return entered(unanswered(*error));
          acquire(session, latest, true, entered);
        });
      });
}

Fleet::Granted Fleet::grant(const SessionName& session, const Owned& owned) {
  std::erase_if(claims_, [](const auto& entry) { return entry.second.expired(); });
  auto claim = claims_[session.text()].lock();
  if (!claim || claim->owner() != owned.claim.owner) {
    claim = std::make_shared<OwnClaim>(*this, owned);
    claims_[session.text()] = claim;
  }
  const auto& [server, epoch, from] = owned.segment;
  Granted granted{std::move(claim), {epoch, from}, nullptr};
  if (!granted.segment.is_first()) {
    granted.earlier = std::make_shared<EarlierSegments>(
        main_, files_, etcd_,
        EarlierSegments::Options{session, epoch, membership_.self().name, folder_});
  }
  return granted;
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

void Fleet::drain_until(Clock::time_point end, const Membership::Done& done) {
  membership_.async_refresh([this, end, done](const auto& error) {
    if (error) return done(error);
    if (!membership_.least_loaded_other()) {
      return done(Error{"no other server of the fleet can take the robots"});
    }
    membership_.async_drain(end, done);
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

std::string Fleet::metrics() const {
  const auto count = [](std::uint64_t number) { return static_cast<double>(number); };
  const EtcdChannel& etcd = etcd_.channel();
  std::string text;
  add(text, "servers", "Servers whose lease lives, this one included",
      count(membership_.servers().size()));
  add(text, "draining", "1: this server sends its robots away",
      membership_.self().is_draining ? 1 : 0);
  add(text, "take_overs_total", "Sessions taken over from another server or process",
      count(ownership_.take_overs()));
  add(text, "epoch_conflicts_total", "Positions not recorded: the session was another server's",
      count(recorder_.conflicts()));
  add(text, "positions_total", "Positions recorded", count(recorder_.records()));
  add(text, "record_requests_total", "Requests that recorded positions",
      count(recorder_.requests()));
  add(text, "record_seconds_total", "Time that these took", to_seconds(recorder_.time_spent()));
  add(text, "etcd_requests_total", "Requests to etcd", count(etcd.requests()));
  add(text, "etcd_failures_total", "Requests that an endpoint did not answer",
      count(etcd.failures()));
  add(text, "etcd_seconds_total", "Time that answered requests took",
      to_seconds(etcd.time_spent()));
  return text;
}

}  // namespace orbbuf::fleet
