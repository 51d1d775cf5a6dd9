// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <string>

#include "server/fleet/fleet.hpp"
#include "server/link/session_claim.hpp"

namespace orbbuf::fleet {

/// The sessions that this server has of the fleet's. `fleet`, `main` and `files` must outlive every
/// run of `main`.
class FleetClaims final : public SessionClaims {
 public:
  /// server: this one's name; folder: its files.path.
  FleetClaims(boost::asio::io_context& main, boost::asio::thread_pool& files, Fleet& fleet,
              std::string server, std::filesystem::path folder);

  void async_enter(const SessionKey& session, std::function<void(Outcome)> entered) override;
  std::string session_in(const std::string& folder) const override;
  std::string refuge() const override { return fleet_.refuge(); }

 private:
  class FleetClaim;

  Granted grant(const SessionKey& session, const Owned& owned);

  boost::asio::io_context& main_;
  boost::asio::thread_pool& files_;
  Fleet& fleet_;
  const std::string server_;
  const std::filesystem::path folder_;
  std::map<SessionKey, std::weak_ptr<FleetClaim>> claims_;
};

}  // namespace orbbuf::fleet
