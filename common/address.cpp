// SPDX-License-Identifier: Apache-2.0
#include "common/address.hpp"

#include <arpa/inet.h>

#include "common/decimal.hpp"

namespace orbbuf {

Result<Address> parse_address(std::string_view text) {
  const auto wrong = [&](std::string_view why) {
    return Error{"expected HOST:PORT or [IPV6]:PORT, got \"" + std::string(text) +
                 "\": " + std::string(why)};
  };
  const std::size_t colon = text.rfind(':');
  if (colon == std::string_view::npos) return wrong("no port");
  std::string_view host = text.substr(0, colon);
  const std::string_view digits = text.substr(colon + 1);
  if (host.starts_with('[') && host.ends_with(']')) {
    host = host.substr(1, host.size() - 2);
  } else if (host.find(':') != std::string_view::npos) {
    return wrong("an IPv6 address needs brackets");
  }
  if (host.empty()) return wrong("no host");
  const auto port = parse_number<std::uint16_t>(digits);
  if (!port) return wrong("the port is not a number from 0 to 65535");
  return Address{std::string(host), *port};
}

std::string to_string(const Address& address) {
  const bool is_ipv6 = address.host.find(':') != std::string::npos;
  return (is_ipv6 ? "[" + address.host + "]" : address.host) + ":" + std::to_string(address.port);
}

bool is_loopback(const Address& address) {
  in_addr ipv4{};
  if (::inet_pton(AF_INET, address.host.c_str(), &ipv4) == 1) {
    return ntohl(ipv4.s_addr) >> 24U == 127;
  }
  in6_addr ipv6{};
  if (::inet_pton(AF_INET6, address.host.c_str(), &ipv6) == 1) return IN6_IS_ADDR_LOOPBACK(&ipv6);
  return address.host == "localhost";
}

}  // namespace orbbuf
