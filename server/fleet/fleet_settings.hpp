// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>
#include <vector>

#include "common/address.hpp"
#include "common/net/tls.hpp"

namespace orbbuf {

/// `[fleet]`: what this server is among several.
struct FleetSettings {
  std::vector<Address> etcd;  ///< empty: it is alone
  std::string name;           ///< of this server; unique in the fleet
  std::string address;        ///< HOST:PORT where robots reach it
  std::string http;           ///< HOST:PORT of its page; empty: none
  std::chrono::seconds lease{5};
  TlsSettings tls;  ///< of the connection to etcd; off: plain TCP

  bool is_on() const { return !etcd.empty(); }

  friend bool operator==(const FleetSettings&, const FleetSettings&) = default;
};

}  // namespace orbbuf
