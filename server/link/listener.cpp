// SPDX-License-Identifier: Apache-2.0
#include "server/link/listener.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <iterator>

#include "common/sample.hpp"
#include "server/runtime/listen_on.hpp"
#include "server/runtime/longest_waiting.hpp"
#include "server/runtime/run_in_pool.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;

constexpr std::size_t kSupersededKept = 1000;
/// Of all connections, those without a hello have one of so many: one under TLS costs 140 kB.
constexpr std::size_t kStrangersShare = 4;

/// Best effort, at once: there is no room to be polite to more than we can serve.
void turn_away(tcp::socket& socket, const std::string& why) {
  const auto message = encode(wire::ErrorMessage{wire::ErrorCode::kRefused, why});
  error_code ignored;
  socket.non_blocking(true, ignored);
  socket.write_some(asio::buffer(message), ignored);
  socket.shutdown(tcp::socket::shutdown_send, ignored);
}

}  // namespace

Listener::Listener(asio::io_context& main, asio::thread_pool& pool, Settings settings,
                   Metrics* metrics)
    : main_(main),
      pool_(pool),
      settings_(std::move(settings)),
      metrics_(metrics),
      commit_(make_group_commit(settings_.sinks, main)),
      tls_(make_tls_context(settings_.listen.tls)),
      acceptor_(listen_on(main, "listen on", settings_.listen.address,
                          settings_.listen.receive_buffer_bytes)),
      retry_(main),
      beat_(main),
      allowed_(settings_.listen.robots) {
  const SinkSettings& sinks = settings_.sinks;
  if (sinks.is_kept()) {
    stores_.emplace(main_, pool_, sinks.files_path, sinks.files_sync, commit_.get());
  }
}

void Listener::start() {
  log_info("{}listening on {}", tls_ ? "with TLS, " : "", to_text(endpoint()));
  if (!tls_ && !is_loopback(settings_.listen.address)) {
    log_warn("listen.insecure: plain TCP on {}; any host on the network can act as any robot",
             to_string(settings_.listen.address));
  }
  accept();
  beat();
}

void Listener::beat() {
  for (const auto& connection : connections_) connection->beat();
  step_aside();
  beat_.expires_after(wire::kHeartbeat);
  beat_.async_wait([this](const error_code& aborted) {
    if (!aborted && !stopped_) beat();
  });
}

void Listener::reload_tls() {
  if (auto context = reload_tls_context(settings_.listen.tls)) tls_ = std::move(context);
}

void Listener::allow(std::vector<std::string> robots) {
  allowed_ = std::move(robots);
  const auto connections = connections_;  // one that ends removes itself from the original
  for (const auto& connection : connections) {
    if (!connection->is_introduced() || is_allowed(connection->robot_id())) continue;
    connection->refuse(connection->robot_id() + " is not among listen.robots any more");
  }
}

bool Listener::is_allowed(const std::string& robot_id) const {
  return allowed_.empty() || std::ranges::find(allowed_, robot_id) != allowed_.end();
}

std::size_t Listener::robots() const {
  return static_cast<std::size_t>(std::ranges::count_if(
      connections_, [](const auto& connection) { return connection->is_introduced(); }));
}

bool Listener::has_session(const std::string& robot_id, const std::string& session_id) const {
  const SessionKey key(robot_id, session_id);
  return sessions_.contains(key) || opening_.contains(key);
}

bool Listener::is_in_use(const std::string& robot_id, const std::string& folder) const {
  return has_session(robot_id, folder) || (stores_ && stores_->is_expected(robot_id, folder));
}

void Listener::accept() {
  acceptor_.async_accept([this](const error_code& failed, tcp::socket socket) {
    if (!acceptor_.is_open()) return;  // stopped
    if (failed) return on_accept_failed(failed);
    on_accepted(std::move(socket));
    accept();
  });
}

/// Out of descriptors or memory, mostly: those who wait in the kernel's queue are not lost.
void Listener::on_accept_failed(const error_code& failed) {
  if (!std::exchange(is_accept_failing_, true)) {
    log_error("accept on {}: {}; trying again", to_text(endpoint()), failed.message());
  }
  retry_.expires_after(kRetry);
  retry_.async_wait([this](const error_code& aborted) {
    if (!aborted && !stopped_) accept();
  });
}

void Listener::on_accepted(tcp::socket socket) {
  if (std::exchange(is_accept_failing_, false)) log_info("accepting connections again");
  error_code gone;
  const auto address = socket.remote_endpoint(gone).address();
  if (gone) return;
  if (const std::string why = make_room(address); !why.empty()) return turn_away(socket, why);
  auto connection = std::make_shared<Connection>(std::move(socket), tls_, settings_.listen, *this);
  connections_.push_back(connection);
  connection->start();
}

/// A connection that serves no robot leaves its place. Empty, or why no place is free.
std::string Listener::make_room(const asio::ip::address& address) {
  const auto is_from_there = [&](const Connection& each) {
    return each.peer().address() == address;
  };
  std::size_t from_there = 0;
  std::size_t strangers = 0;
  for (const auto& connection : connections_) {
    if (is_from_there(*connection)) ++from_there;
    if (connection->is_stranger()) ++strangers;
  }
  const ListenSettings& listen = settings_.listen;
  const bool has_all_its_places = from_there >= listen.max_connections_per_address;
  std::string why;
  if (has_all_its_places) {
    why = fmt::format("{} has all its {} connections", address.to_string(),
                      listen.max_connections_per_address);
  } else if (connections_.size() >= listen.max_connections) {
    why = fmt::format("all {} connections are taken", listen.max_connections);
  } else if (strangers >= std::max<std::size_t>(listen.max_connections / kStrangersShare, 1)) {
    why = fmt::format("{} connections serve no robot", strangers);
  } else {
    return "";
  }
  if (crowding_.lets_through()) log_warn("too many connections: {}", why);
  const auto leaving = longest_waiting(connections_, [&](const Connection& each) {
    return each.is_stranger() && (!has_all_its_places || is_from_there(each));
  });
  if (!leaving) return why;
  leaving->close();
  return "";
}

void Listener::on_hello(const std::shared_ptr<Connection>& connection, const wire::Hello& hello) {
  if (!acceptor_.is_open()) return connection->refuse("the server stops");
  if (has_device_failed()) {
    return refuse(*connection, "the server's disk has failed, it must be started again");
  }
  const SessionKey key(hello.robot_id, hello.session_id);
  if (const std::string why = reason_to_refuse(key); !why.empty()) return refuse(*connection, why);
  close_other_sessions(key);
  SessionInfo info{key.first, key.second, hello.calibration};
  std::ranges::copy_if(hello.streams, std::back_inserter(info.streams), wire::is_sample_stream);
  const auto known = sessions_.find(key);
  if (known != sessions_.end() && !known->second->is_closing()) {
    return connection->join(known->second);
  }
  if (!wait_for(key, connection)) return;
  known == sessions_.end() ? open(key, info) : reopen_later(key, info);
}

/// It will go on trying, several times a second.
void Listener::refuse(Connection& connection, const std::string& why) {
  const bool is_known = std::exchange(last_refusal_, why) == why;
  connection.refuse(why, is_known ? LogLevel::kDebug : LogLevel::kWarn);
}

/// For on_opened(), in place of the connection that has waited before. True: none has.
bool Listener::wait_for(const SessionKey& key, const std::shared_ptr<Connection>& connection) {
  const auto [waiting, is_new] = opening_.try_emplace(key);
  if (const auto old = std::exchange(waiting->second, connection)) old->on_replaced();
  if (reopening_.contains(key)) limit_wait(key);
  return is_new;
}

/// Null: none waits any more, or may connect any more.
std::shared_ptr<Connection> Listener::take_waiting(const SessionKey& key) {
  auto connection = std::move(opening_.extract(key).mapped());
  if (!connection) check_empty();
  if (!connection || is_allowed(key.first)) return connection;
  connection->refuse(key.first + " is not among listen.robots any more");
  return nullptr;
}

/// Nothing is acknowledged any more.
bool Listener::has_device_failed() const {
  return commit_ && commit_->has_failed() && settings_.sinks.files_sync == Durability::kAck;
}

/// What this server's disk does not take, another one's may.
void Listener::step_aside() {
  const auto sessions = sessions_;  // one that ends removes itself from the original
  for (const auto& [key, session] : sessions) session->step_aside(has_device_failed());
}

void Listener::on_session_closed(const SessionKey& key) {
  sessions_.erase(key);
  if (stores_) stores_->on_closed(key.first, key.second);
  if (reopening_.contains(key)) asio::post(main_, [this, key] { reopen(key); });
  check_empty();
}

/// When the earlier one of `key` has ended.
void Listener::reopen_later(const SessionKey& key, const SessionInfo& info) {
  reopening_.try_emplace(key, info, main_);
  limit_wait(key);
}

/// The robot should rather try another server than wait for a disk.
void Listener::limit_wait(const SessionKey& key) {
  auto& limit = reopening_.at(key).limit;
  limit.expires_after(kLongestWait);
  limit.async_wait([this, key](const error_code& aborted) {
    if (aborted || !reopening_.contains(key)) return;
    const auto connection = std::exchange(opening_.at(key), nullptr);
    if (connection) refuse(*connection, "the session is being closed");
  });
}

void Listener::reopen(const SessionKey& key) {
  const auto reopening = reopening_.extract(key);
  if (!opening_.at(key)) {
    take_waiting(key);
  } else {
    open(key, reopening.mapped().info);
  }
}

/// Empty if there is none.
std::string Listener::reason_to_refuse(const SessionKey& key) const {
  const std::string& robot = key.first;
  if (!is_allowed(robot)) return robot + " is not among listen.robots";
  if (std::ranges::find(superseded_, key) != superseded_.end()) {
    return fmt::format("{} has begun another session since {}; are there two of that name?", robot,
                       key.second);
  }
  const auto is_other = [&](const auto& entry) { return entry.first.first != robot; };
  const auto is_opening = [&](const auto& entry) {
    return is_other(entry) && !sessions_.contains(entry.first);
  };
  const auto others =
      std::ranges::count_if(sessions_, is_other) + std::ranges::count_if(opening_, is_opening);
  if (static_cast<std::size_t>(others) < settings_.listen.max_robots) return "";
  return fmt::format("all {} robots' places are taken", settings_.listen.max_robots);
}

/// A robot is in one session at a time: a hello for a new session ends the old one.
void Listener::close_other_sessions(const SessionKey& key) {
  std::vector<std::shared_ptr<Session>> others;
  for (auto it = sessions_.lower_bound({key.first, ""});
       it != sessions_.end() && it->first.first == key.first; ++it) {
    if (it->first != key) others.push_back(it->second);
  }
  const auto supersede = [&](const std::string& session_id) {
    superseded_.emplace_back(key.first, session_id);
    if (superseded_.size() > kSupersededKept) superseded_.pop_front();
  };
  for (const auto& other : others) {
    other->close(SessionEnd::kSuperseded);
    supersede(other->info().session_id);
  }
  for (auto& [other, waiting] : opening_) {
    if (other.first != key.first || other == key || !waiting) continue;
    std::exchange(waiting, nullptr)->on_replaced();
    supersede(other.second);
  }
}

/// The disk may be slow, and a session long: other robots do not wait for it.
void Listener::open(const SessionKey& key, const SessionInfo& info) {
  auto opened = [this, key, info](const Result<OpenedSession>& session) {
    on_opened(key, info, session);
  };
  if (stores_) return stores_->async_open(info, std::move(opened));
  asio::post(main_, [opened = std::move(opened)] { opened(OpenedSession{}); });
}

void Listener::on_opened(const SessionKey& key, SessionInfo info,
                         const Result<OpenedSession>& opened) {
  const auto connection = take_waiting(key);
  if (!connection) {
    if (stores_) stores_->on_closed(key.first, key.second);
    return;
  }
  if (!opened) {
    log_error("{} {}: no session: {}", key.first, key.second, opened.error().text);
    return connection->refuse("the server cannot keep this session: " + opened.error().text);
  }
  auto sinks = make_sinks(settings_.sinks, info, opened.value(), main_, pool_);
  const Session::Timeouts timeouts{settings_.session_timeout, settings_.drain_timeout};
  const auto session = std::make_shared<Session>(
      main_, std::move(info), std::move(sinks), timeouts,
      Session::Events{[this, key] { on_session_closed(key); }, sink_failed_});
  if (metrics_ != nullptr) session->show(metrics_->begin(session->info()));
  sessions_.emplace(key, session);
  connection->join(session);
}

void Listener::on_closed(const std::shared_ptr<Connection>& connection) {
  std::erase(connections_, connection);
  for (auto& [key, waiting] : opening_) {
    if (waiting == connection) waiting = nullptr;
  }
  check_empty();
}

void Listener::drain(std::function<void()> drained) {
  drained_.push_back(std::move(drained));
  if (acceptor_.is_open()) log_info("draining: the robots are sent to other servers");
  end_sessions(SessionEnd::kDraining);
}

void Listener::stop(std::function<void()> stopped) {
  stopped_ = std::move(stopped);
  if (stores_) stores_->stop();
  retry_.cancel();
  beat_.cancel();
  end_sessions(SessionEnd::kStopping);
}

void Listener::end_sessions(SessionEnd end) {
  error_code ignored;  // it is closed either way
  acceptor_.close(ignored);
  // Copies: a session that ends removes itself from the originals.
  const auto connections = connections_;
  for (auto& [key, waiting] : opening_) waiting = nullptr;
  for (const auto& connection : connections) {
    if (!connection->is_introduced()) connection->refuse("the server stops");
  }
  const auto sessions = sessions_;
  for (const auto& [key, session] : sessions) session->close(end);
  check_empty();
}

/// Sessions outlive their connections by what their sinks have begun, connections their sessions by
/// their last words: it is over when both are gone.
bool Listener::is_empty() const {
  return connections_.empty() && sessions_.empty() && opening_.empty();
}

void Listener::check_empty() {
  if (!is_empty()) return;
  const auto drained = std::exchange(drained_, {});
  if (!drained.empty()) log_info("drained: no robot is here any more");
  for (const auto& each : drained) each();
  if (stopped_) std::exchange(stopped_, nullptr)();
}

}  // namespace orbbuf
