// SPDX-License-Identifier: Apache-2.0
#include "server/http/own_host.hpp"

#include <boost/asio/ip/address.hpp>
#include <optional>

namespace orbbuf {
namespace {

namespace ip = boost::asio::ip;

std::string without_port(const std::string& host) {
  const std::size_t colon = host.rfind(':');
  const bool has_port = colon != std::string::npos && host.find(']', colon) == std::string::npos;
  std::string name = has_port ? host.substr(0, colon) : host;
  if (name.starts_with('[') && name.ends_with(']')) name = name.substr(1, name.size() - 2);
  return name;
}

/// Nothing for a name, except for localhost.
std::optional<ip::address> address_of(const std::string& host) {
  const std::string name = without_port(host);
  if (name == "localhost") return ip::address_v4::loopback();
  boost::system::error_code is_name;
  const ip::address address = ip::make_address(name, is_name);
  return is_name ? std::nullopt : std::optional(address);
}

}  // namespace

bool is_own_host(const std::string& host) { return address_of(host).has_value(); }

bool is_own_page(const std::string& page_host, const std::string& host) {
  const auto page = address_of(page_host);
  return page && (page->is_loopback() || page == address_of(host));
}

}  // namespace orbbuf
