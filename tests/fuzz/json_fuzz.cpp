// SPDX-License-Identifier: Apache-2.0
// Any text as a document of the fleet, or as a message of a Foxglove viewer: what is taken for a
// document must say the same again when it is written and read.
#include <cstdlib>
#include <string_view>

#include "server/fleet/fleet_keys.hpp"
#include "server/http/foxglove_protocol.hpp"

namespace {

void require(bool holds) {
  if (!holds) std::abort();
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  namespace fleet = orbbuf::fleet;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  if (const auto owner = fleet::owner_from(text)) {
    require(fleet::owner_from(fleet::to_text(*owner)) == owner);
  }
  if (const auto position = fleet::position_from(text)) {
    require(fleet::position_from(fleet::to_text(*position)) == position);
  }
  const std::string key = std::string(fleet::kServers) + "a";
  if (const auto server = fleet::server_from(key, text)) {
    require(fleet::server_from(key, fleet::to_text(*server)) == server);
  }
  if (const auto session = fleet::session_of(text)) require(!session->robot_id.empty());
  orbbuf::foxglove::parse_request(text);
  return 0;
}
