// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <functional>
#include <memory>

#include "server/http/router.hpp"
#include "server/link/listener.hpp"
#include "server/live/control_socket.hpp"
#include "server/settings.hpp"

namespace orbbuf {

/// This server as one of a fleet (docs/fleet.md). Thread-bound to `main`; must outlive every run of
/// the io_context.
class FleetMember {
 public:
  virtual ~FleetMember() = default;
  /// What the page shows of the fleet.
  virtual FleetPage page() = 0;
  /// Before start(), once: the listener's sessions are the fleet's. It must outlive this.
  virtual void share(Listener& listener) = 0;
  /// Sends the robots to other servers: ControlSocket's command. After share().
  virtual void drain(ControlSocket::Answer answer) = 0;
  virtual void start() = 0;
  /// No more is acknowledged. `stopped` when etcd knows, or does not answer.
  virtual void async_stop(std::function<void()> stopped) = 0;
};

/// Null without [fleet]. Throws std::runtime_error if this build has no fleet, or the keys of
/// settings.fleet.tls cannot be used.
std::unique_ptr<FleetMember> make_fleet_member(boost::asio::io_context& main,
                                               boost::asio::thread_pool& files,
                                               const Settings& settings);

}  // namespace orbbuf
