// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/server_addresses.hpp"

#include <netdb.h>

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <boost/asio/post.hpp>
#include <cstring>
#include <map>
#include <mutex>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include "common/log.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using Endpoint = asio::ip::tcp::endpoint;

constexpr int kMostAtOnce = 5;

Error failure(const Address& server, const char* why) {
  return {"cannot resolve " + server.host + ": " + why};
}

Result<NameLookup::Endpoints> resolve(const Address& server) {
  addrinfo hints{};
  hints.ai_socktype = SOCK_STREAM;
  hints.ai_flags = AI_ADDRCONFIG;
  addrinfo* found = nullptr;
  const int failed = ::getaddrinfo(server.host.c_str(), nullptr, &hints, &found);
  if (failed != 0) return failure(server, ::gai_strerror(failed));
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> owned(found, &::freeaddrinfo);
  NameLookup::Endpoints endpoints;
  for (const addrinfo* one = found; one != nullptr; one = one->ai_next) {
    Endpoint endpoint;
    if (one->ai_addrlen > endpoint.capacity()) continue;
    std::memcpy(endpoint.data(), one->ai_addr, one->ai_addrlen);
    endpoint.resize(one->ai_addrlen);
    endpoint.port(server.port);
    endpoints.push_back(endpoint);
  }
  if (endpoints.empty()) return failure(server, "the name has no address");
  return endpoints;
}

using namespace std::chrono_literals;

constexpr std::size_t kTurns = 4;  // of which all but one are the good address's
constexpr auto kRecent = 10s;      // an older answer says nothing about the link as it is now

/// The one of `servers` with that name; null if there is none.
template <class Servers>
auto* find(Servers& servers, const Address& name) {
  const auto found =
      std::ranges::find_if(servers, [&](const auto& server) { return server.name == name; });
  return found == servers.end() ? nullptr : &*found;
}

}  // namespace

/// What a lookup's thread may touch: it may outlive all else.
struct NameLookup::Shared {
  std::mutex mutex;
  asio::io_context* io;  // null: nothing waits for an answer any more; guarded by mutex
  Found found;           // of the io_context's thread, like the rest
  std::map<std::string, int> pending;  // by HOST:PORT; none is 0
};

NameLookup::NameLookup(asio::io_context& io, Found found) : shared_(std::make_shared<Shared>()) {
  shared_->io = &io;
  shared_->found = std::move(found);
}

NameLookup::~NameLookup() {
  shared_->found = nullptr;
  const std::lock_guard lock(shared_->mutex);
  shared_->io = nullptr;
}

void NameLookup::start(const Address& server) {
  const std::string name = to_string(server);
  if (shared_->pending[name] == kMostAtOnce) return;
  const auto look_up = [shared = shared_, server, name] {
    name_this_thread("lookup");
    auto result = resolve(server);
    const std::lock_guard lock(shared->mutex);
    if (shared->io == nullptr) return;
    asio::post(*shared->io, [shared, server, name, result = std::move(result)] {
      if (--shared->pending[name] == 0) shared->pending.erase(name);
      if (shared->found) shared->found(server, result);
    });
  };
  try {
    std::thread(look_up).detach();
    ++shared_->pending[name];
  } catch (const std::system_error& error) {
    asio::post(*shared_->io, [shared = shared_, server, why = failure(server, error.what())] {
      if (shared->found) shared->found(server, why);
    });
  }
}

ServerAddresses::Server::Server(Address named) : name(std::move(named)) {
  if (const auto endpoint = numeric()) all.push_back(*endpoint);
  is_numeric = !all.empty();
}

std::optional<ServerAddresses::Endpoint> ServerAddresses::Server::numeric() const {
  boost::system::error_code is_name;
  const auto address = boost::asio::ip::make_address(name.host, is_name);
  if (is_name) return std::nullopt;
  return Endpoint(address, name.port);
}

bool ServerAddresses::Server::found(const std::vector<Endpoint>& endpoints) {
  const auto known = std::exchange(all, endpoints);
  const auto news = std::ranges::find_if(all, [&](const Endpoint& endpoint) {
    return std::ranges::find(known, endpoint) == known.end();
  });
  const bool is_new = news != all.end();
  if (is_new) {  // it is next
    other = static_cast<std::size_t>(news - all.begin());
    turn = kTurns - 1;
  }
  if (good && std::ranges::find(all, *good) == all.end()) all.push_back(*good);
  return is_new;
}

ServerAddresses::Endpoint ServerAddresses::Server::next() {
  if (const auto endpoint = numeric()) return *endpoint;
  if (good && ++turn % kTurns != 0) return *good;
  return all[other++ % all.size()];
}

ServerAddresses::ServerAddresses(std::vector<Address> servers) {
  for (Address& server : servers) servers_.emplace_back(std::move(server));
}

std::vector<Address> ServerAddresses::names() const {
  std::vector<Address> names;
  for (const Server& server : servers_) {
    if (!server.is_numeric) names.push_back(server.name);
  }
  return names;
}

bool ServerAddresses::is_empty() const {
  return std::ranges::all_of(servers_, [](const Server& server) { return server.all.empty(); });
}

bool ServerAddresses::is_known(const Address& server) const {
  const auto* const known = find(servers_, server);
  return known != nullptr && !known->all.empty();
}

bool ServerAddresses::found(const Address& server, const std::vector<Endpoint>& endpoints) {
  return find(servers_, server)->found(endpoints);
}

void ServerAddresses::welcomed_at(const ServerAddress& address) {
  Server* const server = find(servers_, address.server);
  server->good = address.endpoint;
  server->turn = 0;
  preferred_ = address.server;
  answered_.reset();
  forget_failures();
}

void ServerAddresses::failed(const Address& server, Time ready) {
  if (preferred_ == server) preferred_.reset();
  Server* const named = find(servers_, server);
  named->has_failed = true;
  named->ready = ready;
  turn_ = static_cast<std::size_t>(named - servers_.data()) + 1;
}

void ServerAddresses::forget_failures() {
  for (Server& server : servers_) server.has_failed = false;
}

bool ServerAddresses::have_all_failed() const {
  return std::ranges::all_of(
      servers_, [](const Server& server) { return server.has_failed || server.all.empty(); });
}

bool ServerAddresses::is_any_ready(Time now) const {
  return std::ranges::any_of(servers_, [&](const Server& server) {
    return !server.all.empty() && (!server.has_failed || server.ready <= now);
  });
}

ServerAddresses::Server* ServerAddresses::next_in_turn(Time now, const Server* except) {
  Server* chosen = nullptr;
  const auto wait = [now](const Server& server) {
    return server.has_failed && server.ready > now ? server.ready - now : Time::duration(0);
  };
  for (std::size_t i = 0; i < servers_.size(); ++i) {
    Server& server = servers_[(turn_ + i) % servers_.size()];
    if (&server == except || server.all.empty()) continue;
    if (chosen == nullptr || wait(server) < wait(*chosen)) chosen = &server;
  }
  if (chosen != nullptr) turn_ = static_cast<std::size_t>(chosen - servers_.data()) + 1;
  return chosen;
}

ServerAddress ServerAddresses::next(Time now) {
  if (preferred_ && is_known(*preferred_)) return next_of(*find(servers_, *preferred_));
  return next_of(*next_in_turn(now, nullptr));
}

std::optional<ServerAddress> ServerAddresses::next_beside(Time now) {
  if (!preferred_ || !is_known(*preferred_)) return std::nullopt;
  Server* const other = next_in_turn(now, find(servers_, *preferred_));
  if (other == nullptr || (other->has_failed && other->ready > now)) return std::nullopt;
  return next_of(*other);
}

bool ServerAddresses::is_wanted(const Address& server, Time now,
                                std::chrono::nanoseconds round_trip) {
  if (!preferred_ || preferred_ == server) return true;
  if (!answered_ || now - *answered_ > kRecent) {
    answered_ = now;
    return false;
  }
  return now - *answered_ >= round_trip;
}

}  // namespace orbbuf
