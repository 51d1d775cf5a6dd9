// SPDX-License-Identifier: Apache-2.0
#include <stdexcept>

#include "server/fleet_commands.hpp"
#include "server/fleet_member.hpp"

namespace orbbuf {

std::unique_ptr<FleetMember> make_fleet_member(boost::asio::io_context& /*main*/,
                                               boost::asio::thread_pool& /*files*/,
                                               const Settings& settings) {
  if (!settings.fleet.is_on()) return nullptr;
  throw std::runtime_error("fleet.etcd: this orbbuf-server was built without ORBBUF_WITH_FLEET");
}

void add_fleet_commands(CommandLine& /*app*/, std::function<int()>& /*command*/) {}

}  // namespace orbbuf
