// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/ip/tcp.hpp>
#include <cstddef>
#include <optional>
#include <vector>

#include "common/address.hpp"

namespace orbbuf {

/// The addresses of the server, and which of them is next to be tried. Those of a name come from a
/// lookup; the address that last welcomed the robot is kept besides, whatever later lookups say.
/// Three of four attempts go to that one, the others to each in turn, so that a server with several
/// addresses, of both families or not, is reached if any of them works. Reentrant.
class ServerAddresses {
 public:
  using Endpoint = boost::asio::ip::tcp::endpoint;

  /// A numeric host, with an IPv6 scope or without, needs no lookup.
  explicit ServerAddresses(Address server);

  bool is_numeric() const { return is_numeric_; }
  bool is_empty() const { return all_.empty(); }

  /// A lookup found `endpoints`, at least one. Returns whether one of them was not known.
  bool found(std::vector<Endpoint> endpoints);
  void welcomed_at(const Endpoint& endpoint);

  /// Where the next attempt goes. Requires !is_empty().
  Endpoint next();

 private:
  /// The address that server_.host is, if it is one. Its scope is the interface of that name now.
  std::optional<Endpoint> numeric() const;

  const Address server_;
  bool is_numeric_ = false;
  std::vector<Endpoint> all_;
  std::optional<Endpoint> good_;  // the one that last welcomed the robot; one of all_
  std::size_t turn_ = 0;
  std::size_t other_ = 0;  // whose turn it is among all_
};

}  // namespace orbbuf
