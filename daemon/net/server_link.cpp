// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/server_link.hpp"

#include <fmt/core.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <random>
#include <utility>

#include "common/log.hpp"
#include "common/seconds.hpp"
#include "daemon/net/bind_interface.hpp"

namespace orbbuf {
namespace asio = boost::asio;
using boost::system::error_code;
using std::chrono::milliseconds;
using std::chrono::seconds;

namespace {

constexpr milliseconds kWatchInterval{50};
constexpr milliseconds kIdleInterval{1000};
constexpr std::chrono::nanoseconds kSilence = 4 * wire::kHeartbeat;
constexpr std::chrono::nanoseconds kPause = kSilence / 2;  // of this program
constexpr seconds kShortestLookupInterval{2};
constexpr seconds kLongestLookupInterval{30};
constexpr int kLookupPartOfOutage = 30;
constexpr std::size_t kMostErrors = 16;

Error no_answer(const ServerConnection& from) { return {"no answer" + from.way().over()}; }

bool is_same_way(const ServerConnection::Way& one, const ServerConnection::Way& other) {
  return one.to == other.to && one.interface == other.interface;
}

/// "a:7722, b:7722": of `servers` those that are not this machine's.
std::string names_of_remote(const std::vector<Address>& servers) {
  std::string names;
  for (const Address& server : servers) {
    if (!is_loopback(server)) names += (names.empty() ? "" : ", ") + to_string(server);
  }
  return names;
}

/// Of those that cannot be used now: an attempt over another may connect before they are tried.
void warn_of_interfaces(const LinkSettings& settings) {
  for (const std::string& interface : settings.interfaces) {
    const int family = interface.find(':') == std::string::npos ? AF_INET : AF_INET6;
    const int socket = ::socket(family, SOCK_STREAM | SOCK_CLOEXEC, 0);
    if (const auto failed = bind_interface(socket, family, interface)) {
      log_warn("link: {}; trying it again with each attempt", failed->text);
    }
    ::close(socket);
  }
}

}  // namespace

ServerLink::ServerLink(asio::io_context& io, LinkSettings settings, wire::Hello hello, Owner& owner)
    : io_(io),
      settings_(std::move(settings)),
      tls_(make_tls_context(settings_.tls, true)),
      hello_(std::move(hello)),
      owner_(owner),
      connection_watch_(settings_.stall_timeout),
      ack_watch_(settings_.ack_timeout),
      candidate_watch_(settings_.stall_timeout),
      interfaces_(settings_.interfaces, settings_.return_after),
      pace_(settings_.attempt_interval / interfaces_.count(), kMostAttempts * interfaces_.count(),
            std::random_device{}()),
      addresses_(settings_.servers),
      lookup_(io,
              [this](const auto& server, const auto& endpoints) { on_found(server, endpoints); }),
      news_(io, [this] { on_network_change(); }),
      attempt_timer_(io),
      watch_timer_(io) {}

ServerLink::~ServerLink() { close(); }

void ServerLink::start() {
  if (const auto remote = names_of_remote(settings_.servers); !tls_ && !remote.empty()) {
    log_warn(
        "link: plain TCP to {}: any host on the path can read and change the frames; "
        "docs/security.md says how to set up [tls]",
        remote);
  }
  warn_of_interfaces(settings_);
  begin_outage();
  attempt_at(Clock::now());
  news_.start();
  watch();
}

void ServerLink::reload_tls() {
  if (auto context = reload_tls_context(settings_.tls)) tls_ = std::move(context);
}

void ServerLink::close() {
  state_ = State::kClosed;
  close_attempts();
  for (auto* open : {&candidate_, &connection_}) {
    if (*open) (*open)->close();
    open->reset();
  }
  watch_timer_.cancel();
  news_.stop();
}

std::optional<TcpProgress> ServerLink::progress() const {
  return connection_ ? connection_->progress() : std::nullopt;
}

bool ServerLink::is_attempt_due() const {
  return (state_ == State::kConnecting || state_ == State::kStalled) &&
         (!candidate_ || candidate_watch_.is_stalled());
}

void ServerLink::begin_outage() {
  watch_closely();
  pace_.on_outage(Clock::now());
  look_up();
}

void ServerLink::attempt_at(Clock::time_point time) {
  attempt_timer_.expires_at(time);
  attempt_timer_.async_wait([this](const error_code& error) {
    if (!error && is_attempt_due() && attempt_timer_.expiry() <= Clock::now()) attempt();
  });
}

void ServerLink::attempt() {
  if (addresses_.is_empty()) return;  // on_found() goes on
  const auto now = Clock::now();
  if (round_.empty() || interfaces_.is_round_begin()) {
    round_ = {addresses_.next(now)};
    if (auto beside = addresses_.next_beside(now)) round_.push_back(std::move(*beside));
  }
  const std::string& interface = interfaces_.next();
  for (const ServerAddress& to : round_) {
    make_room();
    open({to, interface, segment_size_.limit()});
  }
  pace_.on_attempt(now);
  attempt_at(addresses_.have_all_failed() ? pace_.next(now) : pace_.next_elsewhere(now));
}

void ServerLink::open(const ServerConnection::Way& way) {
  attempts_.push_back({std::make_shared<ServerConnection>(
                           io_, tls_.get(), static_cast<ServerConnection::Owner&>(*this)),
                       Clock::now()});
  attempts_.back().connection->open(way, hello_,
                                    static_cast<std::uint32_t>(settings_.unsent_bytes));
}

/// Sees if the preferred interface reaches the server, while another carries the stream.
void ServerLink::probe() {
  close_attempts();
  interfaces_.on_probe(Clock::now());
  open({connection_->way().to, interfaces_.preferred(), segment_size_.limit()});
}

/// Keeps the oldest attempt of each way: it is the one for a long round trip.
void ServerLink::make_room() {
  const std::size_t at_a_time = addresses_.count() > 1 ? 2 : 1;
  if (attempts_.size() < kMostAttempts * interfaces_.count() * at_a_time) return;
  const auto spare = std::ranges::find_if(attempts_, [this](const Attempt& attempt) {
    const auto oldest = std::ranges::find_if(attempts_, [&](const Attempt& other) {
      return is_same_way(other.connection->way(), attempt.connection->way());
    });
    return &*oldest != &attempt;
  });
  give_up(spare == attempts_.end() ? attempts_.begin() : spare);
}

void ServerLink::give_up(std::vector<Attempt>::iterator attempt) {
  const auto connection = attempt->connection;
  connection->close();
  attempts_.erase(attempt);
  note_failure(connection->way().to.server, no_answer(*connection));
}

void ServerLink::close_attempts() {
  attempt_timer_.cancel();
  for (const Attempt& attempt : attempts_) attempt.connection->close();
  attempts_.clear();
}

void ServerLink::look_up() {
  lookup_time_ = Clock::now();
  for (const Address& server : addresses_.names()) lookup_.start(server);
}

void ServerLink::on_found(const Address& server, const Result<NameLookup::Endpoints>& endpoints) {
  if (!endpoints) {
    if (!addresses_.is_known(server)) on_not_found(server, endpoints.error());
    return;
  }
  if (addresses_.found(server, endpoints.value()) && is_attempt_due()) {
    attempt_at(pace_.soonest());
  }
}

/// Beside a connection, too: the server is none that could take its place.
void ServerLink::on_not_found(const Address& server, const Error& why) {
  if (state_ != State::kConnected) return note_failure(server, why);
  if (known_errors_.insert(to_string(server) + why.text).second) log_warn("link: {}", why.text);
}

/// An interface has come up, or an address, or a route: as good as the link's return.
void ServerLink::on_network_change() {
  segment_size_.reset();
  if (!is_attempt_due()) return;
  begin_outage();
  attempt_at(pace_.soonest());
}

void ServerLink::note_failure(const Address& server, const Error& why) {
  const std::string name = to_string(server);
  has_tried_ = true;
  last_error_ = addresses_.count() > 1 ? name + ": " + why.text : why.text;
  if (connection_ || known_errors_.size() == kMostErrors) return;
  if (!known_errors_.insert(name + why.text).second) return;
  log_warn("link: no connection to {}: {}; trying on", name, why.text);
}

void ServerLink::on_failed(const ServerConnection& from, const Error& error) {
  if (&from == candidate_.get()) return on_candidate_failed(error);
  if (&from == connection_.get()) return on_connection_lost(from, error);
  std::erase_if(attempts_, [&](const Attempt& one) { return one.connection.get() == &from; });
  if (state_ == State::kConnected) return interfaces_.on_probe_failed();
  note_failure(from.way().to.server, error);
}

void ServerLink::on_candidate_failed(const Error& why) {
  const auto failed = std::exchange(candidate_, nullptr);
  failed->close();
  if (state_ == State::kConnected) return on_return_failed(why);
  note_failure(failed->way().to.server, why);
  if (failed->was_refused()) return on_refused(*failed);
  const auto now = Clock::now();
  if (!candidate_watch_.is_stalled()) leave(failed->way().to.server, now);
  attempt_at(pace_.next(now));
}

/// From now on others are tried, and this one not before `ready` if there are any.
void ServerLink::leave(const Address& server, Clock::time_point ready) {
  addresses_.failed(server, ready);
  round_.clear();
}

/// The server has answered, and wants none of this robot: another one is tried at once.
void ServerLink::on_refused(const ServerConnection& from) {
  const auto now = Clock::now();
  pace_.on_refused(now);
  const auto ready = pace_.next(now);
  leave(from.way().to.server, ready);
  attempt_at(addresses_.is_any_ready(now) ? now : ready);
}

/// The stream is where it was. It says nothing about attempts to come: something else may have
/// answered on that interface, such as the page of a network that wants a login.
void ServerLink::on_return_failed(const Error& why) {
  interfaces_.on_return_failed();
  log_info("link: no return to {}: {}", interfaces_.preferred(), why.text);
}

void ServerLink::on_connection_lost(const ServerConnection& from, const Error& why) {
  connection_.reset();
  const bool was_stalled = std::exchange(state_, State::kConnecting) == State::kStalled;
  owner_.on_disconnected();
  log_at(was_stalled || candidate_ ? LogLevel::kInfo : LogLevel::kWarn,
         "link: connection to {} lost: {}", from.way().name(), why.text);
  if (from.was_sent_away()) leave(from.way().to.server, Clock::now());
  if (was_stalled) return;  // others are on their way already
  interfaces_.start_over();
  begin_outage();
  if (from.was_refused()) return on_refused(from);
  attempt_at(pace_.first(Clock::now()));
}

void ServerLink::on_step(const ServerConnection& from) {
  if (&from != candidate_.get()) {
    if (state_ == State::kConnected && !interfaces_.on_answer(Clock::now())) {
      return close_attempts();
    }
    if (state_ != State::kConnected && !is_wanted(from)) return;
    promote(from);
  }
  step_time_ = Clock::now();
}

/// Else the attempt is closed: the link is there, and the server that is preferred may answer, too.
bool ServerLink::is_wanted(const ServerConnection& answered) {
  const auto now = Clock::now();
  if (addresses_.is_wanted(answered.way().to.server, now, pace_.round_trip())) return true;
  const auto found = std::ranges::find_if(
      attempts_, [&](const Attempt& one) { return one.connection.get() == &answered; });
  const auto closed = found->connection;
  attempts_.erase(found);
  closed->close();
  attempt_at(pace_.soonest());
  return false;
}

void ServerLink::promote(const ServerConnection& from) {
  if (candidate_) {  // it has lost the link
    if (!candidate_->has_said_hello()) segment_size_.on_nothing_large();
    candidate_->close();
  }
  const auto found = std::ranges::find_if(
      attempts_, [&](const Attempt& one) { return one.connection.get() == &from; });
  candidate_ = found->connection;
  attempts_.erase(found);
  close_attempts();
  candidate_watch_.restart(Clock::now());
}

std::optional<Error> ServerLink::refusal_of(const wire::Position& position) {
  if (owner_.can_be_at(position)) return std::nullopt;
  return Error{
      fmt::format("the server's record of this session reaches frame {} and drop record {}, which, "
                  "or the samples there, this robot has not sent: does another robot use its id?",
                  position[wire::kFrames], position[wire::kDrops])};
}

void ServerLink::on_welcome(const wire::Position& position) {
  has_tried_ = true;
  if (connection_) connection_->close();  // the server has left it for this one
  connection_ = std::move(candidate_);
  close_attempts();
  state_ = State::kConnected;
  pace_.on_welcome();
  addresses_.welcomed_at(connection_->way().to);
  if (std::exchange(pausing_, server()) != server()) pause_.clear();
  interfaces_.on_connected(connection_->way().interface, Clock::now());
  last_error_.clear();
  known_errors_.clear();
  connection_watch_.restart(Clock::now());
  ack_watch_.restart();
  const auto progress = connection_->progress();
  segment_size_.on_welcome(progress ? progress->acked_bytes : 0);
  log_info("link: connected to {}{}{}; its record of this session reaches frame {}",
           to_string(server()), tls_ ? " over TLS" : "", connection_->way().over(),
           position[wire::kFrames]);
  owner_.on_connected(position);
}

void ServerLink::on_ack(const wire::Ack& ack) {
  ack_watch_.on_ack(ack);
  if (ack.pause.empty() && !pause_.empty()) {
    log_info("link: {} takes frames again", to_string(server()));
  } else if (!ack.pause.empty() && pause_.empty()) {
    log_warn("link: {} takes nothing at the moment: {}; mend this on the server",
             to_string(server()), ack.pause);
  }
  pause_ = ack.pause;
  owner_.on_ack(ack);
}

void ServerLink::watch() {
  watch_timer_.expires_after(is_idle_ ? kIdleInterval : kWatchInterval);
  watch_timer_.async_wait([this](const error_code& error) {
    if (error || state_ == State::kClosed) return;
    if (candidate_) check_candidate();
    if (connection_) check_connection();
    if (state_ == State::kConnected && !candidate_ && interfaces_.is_probe_due(Clock::now())) {
      probe();
    }
    check_attempts();
    is_idle_ = !is_anything_open(progress());
    watch();
  });
}

/// Whether something may stall, fail or be late.
bool ServerLink::is_anything_open(const std::optional<TcpProgress>& progress) const {
  return state_ != State::kConnected || candidate_ || !attempts_.empty() || ack_watch_.is_owed() ||
         !progress || progress->is_waiting() || progress->unsent_bytes > 0;
}

/// What is written, or tried, from now on has not stood still since the last look.
void ServerLink::watch_closely() {
  if (!std::exchange(is_idle_, false)) return;
  connection_watch_.look(progress(), Clock::now());
  watch();
}

std::chrono::nanoseconds ServerLink::patience() const {
  return std::max(settings_.connect_timeout, 4 * pace_.round_trip());
}

void ServerLink::check_candidate() {
  const auto now = Clock::now();
  const bool was_stalled = candidate_watch_.is_stalled();
  candidate_watch_.look(candidate_->progress(), now);
  if (now - step_time_ > patience()) {
    if (!candidate_->has_said_hello() && state_ != State::kConnected) {
      segment_size_.on_nothing_large();
    }
    return on_candidate_failed(no_answer(*candidate_));
  }
  if (candidate_watch_.is_stalled() == was_stalled) return;
  if (was_stalled) return close_attempts();
  attempt_at(pace_.soonest());
}

void ServerLink::check_attempts() {
  const auto now = Clock::now();
  while (!attempts_.empty() && now - attempts_.front().since > patience()) {
    give_up(attempts_.begin());
  }
  if (addresses_.is_empty() && !has_tried_ && pace_.outage(now) > patience()) {
    for (const Address& server : addresses_.names()) {
      note_failure(server, {"cannot resolve " + server.host + ": no answer"});
    }
  }
  const auto lookup_interval = std::clamp<std::chrono::nanoseconds>(
      pace_.outage(now) / kLookupPartOfOutage, kShortestLookupInterval, kLongestLookupInterval);
  if (is_attempt_due() && now - lookup_time_ >= lookup_interval) look_up();
}

void ServerLink::check_connection() {
  const auto progress = connection_->progress();
  const auto now = Clock::now();
  ack_watch_.look(progress, now);
  if (now - std::exchange(check_time_, now) > kPause || connection_watch_.is_stalled()) {
    ack_watch_.excuse(now);
  }
  connection_watch_.look(progress, now);
  if (is_silent()) return on_silence();
  if (connection_watch_.is_moving()) {
    if (progress) pace_.on_round_trip(progress->least_round_trip);
    return on_recovered();
  }
  if (state_ == State::kStalled || !connection_watch_.is_stalled()) return;
  state_ = State::kStalled;
  segment_size_.on_stall(progress->acked_bytes);
  log_warn("link: connection to {} stalled, nothing acknowledged for {:.1f} s; trying another",
           connection_->way().name(), to_seconds(connection_watch_.still_for()));
  interfaces_.on_stall();
  begin_outage();
  attempt_at(Clock::now());
}

/// A stalled connection says nothing of the server.
bool ServerLink::is_silent() const {
  if (ack_watch_.is_silent()) return true;
  if (!connection_->welcome().has_heartbeat) return false;
  return !connection_watch_.is_stalled() &&
         ack_watch_.silent_for() >= std::max(kSilence, 4 * pace_.round_trip());
}

/// Where there is another server to go to, a second connection to the silent one would only be
/// waited for.
void ServerLink::on_silence() {
  const auto silent = connection_;
  const Address& from = silent->way().to.server;
  silent->close();
  const bool has_another = candidate_ && candidate_->way().to.server != from;
  if (addresses_.count() > 1 && !has_another) end_stall();
  leave(from, Clock::now());
  on_connection_lost(*silent, {fmt::format("the server has acknowledged nothing for {:.1f} s",
                                           to_seconds(ack_watch_.silent_for()))});
}

/// Once another has said hello the server may have left this one for it: then the candidate is seen
/// through, and the server says which of the two it has left.
void ServerLink::on_recovered() {
  if (state_ != State::kStalled || (candidate_ && candidate_->has_said_hello())) return;
  end_stall();
  log_info("link: connection to {} recovered", to_string(server()));
}

/// Ends all that was begun beside the connection.
void ServerLink::end_stall() {
  state_ = State::kConnected;
  close_attempts();
  if (candidate_) candidate_->close();
  candidate_.reset();
}

}  // namespace orbbuf
