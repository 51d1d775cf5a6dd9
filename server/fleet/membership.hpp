// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>

#include "server/fleet/fleet_keys.hpp"
#include "server/fleet/key_store.hpp"

namespace orbbuf::fleet {

/// This server's key, kept alive by a lease, and those of the others. Both are seen to each third
/// of the lease. Thread-bound to `main`; must outlive every run of the io_context.
class Membership {
 public:
  using Servers = std::map<std::string, ServerEntry>;  // by name
  using Done = std::function<void(const std::optional<Error>&)>;

  /// robots: how many there are, for the key.
  Membership(boost::asio::io_context& main, KeyStore& store, ServerEntry self,
             std::chrono::seconds lease, std::function<std::uint64_t()> robots);

  /// A key of that name which another server has written is not replaced. If it is there for longer
  /// than the lease of a server that has died, this one must not serve: start() leads to a
  /// std::runtime_error out of the io_context's run(), before any robot is taken.
  void start() { beat(); }
  /// Gives up the lease, so that others need not wait for its end; takes at most a second.
  void async_stop(std::function<void()> stopped);
  /// From here on others may take this server's sessions, until `end`, or the end of an earlier
  /// drain if that is later. `done` when they can know.
  void async_drain(std::chrono::steady_clock::time_point end, Done done);
  /// Reads the others' keys now.
  void async_refresh(Done done);

  /// The others can know of this server.
  bool has_joined() const { return written_.has_value(); }
  /// As they were read last.
  const Servers& servers() const { return servers_; }
  const ServerEntry& self() const { return self_; }
  /// The server with the fewest robots; nothing if there is no other that lives and takes some.
  std::optional<ServerEntry> least_loaded_other() const;

 private:
  void beat();
  void keep();
  void join();
  void write(Done done);
  void on_refused(const KeyTxnOutcome& outcome, const Done& done);
  void beat_later(const std::optional<Error>& error);

  KeyStore& store_;
  ServerEntry self_;
  const std::chrono::seconds ttl_;
  const std::function<std::uint64_t()> robots_;
  boost::asio::steady_timer timer_;
  std::int64_t lease_ = 0;  // 0: none
  std::optional<ServerEntry> written_;
  std::int64_t revision_ = 0;  // of the key; 0: it is not there
  bool has_ever_joined_ = false;
  std::chrono::steady_clock::time_point drain_end_{};  // of self_, if it drains
  std::optional<std::chrono::steady_clock::time_point> doubled_since_;
  Servers servers_;
  bool is_failing_ = false;
  bool is_stopped_ = false;
};

}  // namespace orbbuf::fleet
