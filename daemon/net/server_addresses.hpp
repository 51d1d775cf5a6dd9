// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <chrono>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "common/address.hpp"
#include "common/error.hpp"

namespace orbbuf {

/// Looks up the addresses of servers by their names, without holding up the thread that asks,
/// neither meanwhile nor at the end: each lookup has a thread of its own, which nothing waits for.
/// A name server behind a dead link keeps such a thread for tens of seconds; several may therefore
/// be on their way, so that the first to be sent after the link's return is answered.
///
/// Thread-bound to the thread that runs the io_context, which must outlive the lookup.
class NameLookup {
 public:
  using Endpoints = std::vector<boost::asio::ip::tcp::endpoint>;
  /// At least one endpoint of the server, or why there is none. Called from the io_context.
  using Found = std::function<void(const Address& server, const Result<Endpoints>&)>;

  NameLookup(boost::asio::io_context& io, Found found);
  /// No more calls to `found`.
  ~NameLookup();

  /// Does nothing while five lookups of that server are on their way.
  void start(const Address& server);

 private:
  struct Shared;

  const std::shared_ptr<Shared> shared_;
};

/// One address of a server.
struct ServerAddress {
  Address server;  ///< as it is named: messages and certificates have this
  boost::asio::ip::tcp::endpoint endpoint;

  bool operator==(const ServerAddress&) const = default;
};

/// The servers that may take the robot, their addresses, and which of them is next to be tried.
///
/// The addresses of a name come from a lookup; the one that last welcomed the robot is kept
/// besides, whatever later lookups say. Three of four attempts at a server go to that one, the
/// others to each in turn, so that a server with several addresses, of both families or not, is
/// reached if any of them works.
///
/// With several servers, the one that last welcomed the robot is preferred: each attempt goes
/// there, and one at another server, in turn, goes beside it. Without
/// a preferred server each has its turn. When another one answers, the link is there, and the
/// preferred one has a round trip more to answer: an outage of the link does not change the server.
/// Knows no clock and no socket. Reentrant.
class ServerAddresses {
 public:
  using Endpoint = boost::asio::ip::tcp::endpoint;
  using Time = std::chrono::steady_clock::time_point;

  /// servers: at least one, all different. A numeric host, with an IPv6 scope or without, needs no
  /// lookup.
  explicit ServerAddresses(std::vector<Address> servers);

  std::size_t count() const { return servers_.size(); }
  /// Those whose hosts are to be looked up.
  std::vector<Address> names() const;
  /// Whether no server has an address.
  bool is_empty() const;
  bool is_known(const Address& server) const;

  /// A lookup of `server` found `endpoints`, at least one. Returns whether one of them was not
  /// known.
  bool found(const Address& server, const std::vector<Endpoint>& endpoints);
  void welcomed_at(const ServerAddress& address);
  /// `server` answered and did not welcome the robot: others are preferred, and it is not tried
  /// before `ready` if another may be.
  void failed(const Address& server, Time ready);
  /// A name without an address is not, and counts as failed.
  bool is_any_ready(Time now) const;
  bool have_all_failed() const;

  /// Where the next attempt goes. Requires !is_empty().
  ServerAddress next(Time now);
  /// Where an attempt beside the last of next() goes, if anywhere.
  std::optional<ServerAddress> next_beside(Time now);
  /// `server` has answered an attempt. Returns whether it is the one to go on with.
  bool is_wanted(const Address& server, Time now, std::chrono::nanoseconds round_trip);

 private:
  struct Server {
    explicit Server(Address named);
    /// The address that name.host is, if it is one. Its scope is the interface of that name now.
    std::optional<Endpoint> numeric() const;
    bool found(const std::vector<Endpoint>& endpoints);
    Endpoint next();

    Address name;
    bool is_numeric = false;
    std::vector<Endpoint> all;
    std::optional<Endpoint> good;  // the one that last welcomed the robot; one of all
    std::size_t turn = 0;
    std::size_t other = 0;  // whose turn it is among all
    bool has_failed = false;
    Time ready{};  // has_failed: not to be tried before
  };

  /// Of those with an address but `except`: the next in turn that is ready, else the next that will
  /// be. Null without one.
  Server* next_in_turn(Time now, const Server* except);
  ServerAddress next_of(Server& server) { return {server.name, server.next()}; }
  /// The servers may be tried again whatever they said.
  void forget_failures();

  std::vector<Server> servers_;
  std::optional<Address> preferred_;  // one of servers_
  std::size_t turn_ = 0;              // whose turn it is among servers_
  std::optional<Time> answered_;      // since the last welcome a server did that is not preferred
};

}  // namespace orbbuf
