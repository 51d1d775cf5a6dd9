// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "common/error.hpp"

namespace orbbuf {

/// Where a TCP server is: a host name or a numeric address (IPv6 without brackets), and a port.
struct Address {
  std::string host;
  std::uint16_t port = 0;

  friend bool operator==(const Address&, const Address&) = default;
};

/// `HOST:PORT` or `[IPV6]:PORT`. Port 0 is accepted.
Result<Address> parse_address(std::string_view text);

/// The inverse of parse_address().
std::string to_string(const Address& address);

/// Whether only this machine can be meant: 127.0.0.0/8, ::1 or localhost. No name is looked up.
bool is_loopback(const Address& address);

}  // namespace orbbuf
