// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/server_addresses.hpp"

#include <algorithm>
#include <boost/asio/ip/address.hpp>
#include <utility>

namespace orbbuf {
namespace {

constexpr std::size_t kTurns = 4;  // of which all but one are the good address's

}  // namespace

ServerAddresses::ServerAddresses(Address server) : server_(std::move(server)) {
  if (const auto endpoint = numeric()) all_.push_back(*endpoint);
  is_numeric_ = !all_.empty();
}

std::optional<ServerAddresses::Endpoint> ServerAddresses::numeric() const {
  boost::system::error_code is_name;
  const auto address = boost::asio::ip::make_address(server_.host, is_name);
  if (is_name) return std::nullopt;
  return Endpoint(address, server_.port);
}

bool ServerAddresses::found(std::vector<Endpoint> endpoints) {
  const auto known = std::exchange(all_, std::move(endpoints));
  const auto news = std::ranges::find_if(all_, [&](const Endpoint& endpoint) {
    return std::ranges::find(known, endpoint) == known.end();
  });
  const bool is_new = news != all_.end();
  if (is_new) {  // it is next
    other_ = static_cast<std::size_t>(news - all_.begin());
    turn_ = kTurns - 1;
  }
  if (good_ && std::ranges::find(all_, *good_) == all_.end()) all_.push_back(*good_);
  return is_new;
}

void ServerAddresses::welcomed_at(const Endpoint& endpoint) {
  good_ = endpoint;
  turn_ = 0;
}

ServerAddresses::Endpoint ServerAddresses::next() {
  if (const auto endpoint = numeric()) return *endpoint;
  if (good_ && ++turn_ % kTurns != 0) return *good_;
  return all_[other_++ % all_.size()];
}

}  // namespace orbbuf
