// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "server/fleet/etcd_client.hpp"
#include "server/fleet/fleet_settings.hpp"
#include "server/fleet/membership.hpp"
#include "server/fleet/overview.hpp"
#include "server/fleet/ownership.hpp"
#include "server/fleet/position_recorder.hpp"

namespace orbbuf::fleet {

/// This server as one of several that share their robots through etcd (docs/fleet.md). What it
/// promises: a position is acknowledged only after etcd has recorded it under this server's claim,
/// and a claim ends before the next owner begins.
///
/// Thread-bound to `main`; must outlive every run of the io_context.
class Fleet {
 public:
  /// Where a robot should go instead.
  struct Moved {
    std::string address;
  };
  using Entered = std::function<void(Result<std::variant<Owned, Moved>>)>;

  /// A robot that was sent away and comes again within this time cannot reach the other server: it
  /// stays.
  static constexpr std::chrono::seconds kInsistence{10};

  /// Throws std::runtime_error if the keys of settings.tls cannot be used. folder: its files.path.
  /// robots: of this server.
  Fleet(boost::asio::io_context& main, const FleetSettings& settings,
        const std::filesystem::path& folder, std::function<std::uint64_t()> robots);

  void start();
  /// No more is recorded. `stopped` when etcd knows, or does not answer.
  void async_stop(std::function<void()> stopped);

  /// A robot wants that session here, and gets it, unless this server drains, or the session is new
  /// and another server has fewer robots. May answer from within the call.
  void async_enter(const SessionName& session, Entered entered);
  PositionRecorder& recorder() { return recorder_; }
  const PositionRecorder& recorder() const { return recorder_; }
  void end(const Owned& owned) { ownership_.end(owned); }

  bool is_draining() const { return membership_.self().is_draining; }
  /// From here on no session begins. `done` when the others know; an error if there is none.
  void async_drain(Membership::Done done);
  /// Waits until another server has each of these, or their robot has ended it, for kInsistence at
  /// most. `done` with those that are still this server's.
  void async_leave(std::vector<SessionName> sessions,
                   std::function<void(Result<std::vector<SessionName>>)> done);
  /// Where robots can go; empty: nowhere.
  std::string refuge() const;

  KeyStore& store() { return etcd_; }
  const Membership& membership() const { return membership_; }
  const Ownership& ownership() const { return ownership_; }
  const EtcdChannel& channel() const { return etcd_.channel(); }
  Overview& overview() { return overview_; }

 private:
  using Clock = std::chrono::steady_clock;

  std::optional<std::string> better() const;
  std::string refuge_name() const;
  void acquire(const SessionName& session, bool is_fresh, Entered entered);
  void await_leaving(std::vector<SessionName> sessions, Clock::time_point limit,
                     std::function<void(Result<std::vector<SessionName>>)> done);
  void send_away(const SessionName& session, const std::string& server, const Entered& entered);

  boost::asio::io_context& main_;
  EtcdClient etcd_;
  Membership membership_;
  Ownership ownership_;
  PositionRecorder recorder_;
  EtcdClient viewers_etcd_;  // a lease does not wait behind what is read for people
  Overview overview_;
  std::map<std::string, Clock::time_point> sent_away_;  // by SessionName::text()
};

}  // namespace orbbuf::fleet
