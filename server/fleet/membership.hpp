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

  void start();
  /// Gives up the lease, so that others need not wait for its end; takes at most a second.
  void async_stop(std::function<void()> stopped);
  /// From here on others may take this server's sessions. `done` when they can know.
  void async_drain(Done done);
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
  void beat_later(const std::optional<Error>& error);

  KeyStore& store_;
  ServerEntry self_;
  const std::chrono::seconds ttl_;
  const std::function<std::uint64_t()> robots_;
  boost::asio::steady_timer timer_;
  std::int64_t lease_ = 0;  // 0: none
  std::optional<ServerEntry> written_;
  Servers servers_;
  bool is_failing_ = false;
  bool is_doubled_ = false;
  bool is_stopped_ = false;
};

}  // namespace orbbuf::fleet
