// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/address.hpp"
#include "common/error.hpp"
#include "server/fleet/etcd_client.hpp"
#include "server/fleet/fleet_settings.hpp"
#include "server/fleet/key_store.hpp"
#include "server/fleet/membership.hpp"
#include "server/fleet/ownership.hpp"
#include "server/fleet/position_recorder.hpp"
#include "server/link/session_claim.hpp"

namespace orbbuf::fleet {

/// Servers and sessions as JSON, for people: a page of kPage sessions at a time, read from etcd.
/// However many ask, a page is read once in kFresh, so that they cost the robots nothing to speak
/// of. Thread-bound to `main`.
class Overview {
 public:
  static constexpr std::size_t kPage = 500;
  static constexpr std::chrono::seconds kFresh{2};
  using Done = std::function<void(const Result<std::string>&)>;

  /// `store`: not the way that a lease is kept alive by, which must not wait. It must outlive this.
  /// `etcd`: for the viewer.
  Overview(KeyStore& store, std::vector<Address> etcd) : store_(store), etcd_(std::move(etcd)) {}

  /// The page that begins with that session, ROBOT/SESSION; empty: the first. `next` in it is the
  /// first session of the page behind it.
  void async_page(const std::string& from, const Done& done);

 private:
  using Clock = std::chrono::steady_clock;

  struct Page {
    std::optional<Clock::time_point> read_at;  // nothing: it is being read
    std::string json;
    std::vector<Done> waiting;
  };
  using Keys = std::vector<KeyValue>;

  void read(const std::string& from);
  void finish(const std::string& from, const Result<std::string>& json);
  std::string to_json(const Keys& servers, Keys owners, const Keys& positions) const;

  KeyStore& store_;
  const std::vector<Address> etcd_;
  std::map<std::string, Page> pages_;  // by `from`
};

/// This server as one of several that share their robots through etcd (docs/fleet.md). What it
/// promises: a position is acknowledged only after etcd has recorded it under this server's claim,
/// and a claim ends before the next owner begins.
///
/// Thread-bound to `main`; must outlive every run of the io_context, as `files` must.
class Fleet final : public SessionClaims {
 public:
  /// A robot that was sent away and comes again within this time cannot reach the other server: it
  /// stays.
  static constexpr std::chrono::seconds kInsistence{10};

  /// Throws std::runtime_error if the keys of settings.tls cannot be used. folder: its files.path.
  /// robots: of this server.
  Fleet(boost::asio::io_context& main, boost::asio::thread_pool& files,
        const FleetSettings& settings, std::filesystem::path folder,
        std::function<std::uint64_t()> robots);

  void start();
  /// No more is recorded. `stopped` when etcd knows, or does not answer.
  void async_stop(std::function<void()> stopped);

  /// A robot wants that session here, and gets it, unless this server drains, or the session is new
  /// and another server has fewer robots. May answer from within the call.
  void async_enter(const SessionKey& session, std::function<void(Outcome)> entered) override;
  std::string session_in(const std::string& folder) const override {
    return parse_folder(folder).session_id;
  }
  std::string refuge() const override;
  void async_step_aside(Membership::Done done) override {
    drain_until(Clock::now() + kAside, done);
  }

  /// From here on no session begins. `done` when the others know; an error if there is none.
  void async_drain(const Membership::Done& done) { drain_until(Clock::time_point::max(), done); }
  /// Waits until another server has each of these, or their robot has ended it, for kInsistence at
  /// most. `done` with those that are still this server's.
  void async_leave(std::vector<SessionName> sessions,
                   std::function<void(Result<std::vector<SessionName>>)> done);

  Overview& overview() { return overview_; }
  /// For /metrics, in Prometheus' text format; docs/fleet.md lists the names.
  std::string metrics() const;

 private:
  using Clock = std::chrono::steady_clock;
  using Entered = std::function<void(Outcome)>;
  class OwnClaim;
  static constexpr std::chrono::seconds kAside{30};

  void drain_until(Clock::time_point end, const Membership::Done& done);
  std::optional<std::string> better() const;
  void acquire(const SessionName& session, const std::optional<OnDisk>& latest, bool is_fresh,
               Entered entered);
  Granted grant(const SessionName& session, const Owned& owned);
  void await_leaving(std::vector<SessionName> sessions, Clock::time_point limit,
                     std::function<void(Result<std::vector<SessionName>>)> done);
  void send_away(const SessionName& session, const std::string& server, const Entered& entered);

  boost::asio::io_context& main_;
  boost::asio::thread_pool& files_;
  const std::filesystem::path folder_;
  EtcdClient etcd_;
  Membership membership_;
  Ownership ownership_;
  PositionRecorder recorder_;
  EtcdClient viewers_etcd_;  // a lease does not wait behind what is read for people
  Overview overview_;
  std::map<std::string, Clock::time_point> sent_away_;     // by SessionName::text()
  std::map<std::string, std::weak_ptr<OwnClaim>> claims_;  // likewise
};

}  // namespace orbbuf::fleet
