// SPDX-License-Identifier: Apache-2.0
#include "server/http/own_host.hpp"

#include <boost/asio/ip/address.hpp>

namespace orbbuf {

bool is_own_host(const std::string& host) {
  const std::size_t colon = host.rfind(':');
  const bool has_port = colon != std::string::npos && host.find(']', colon) == std::string::npos;
  std::string name = has_port ? host.substr(0, colon) : host;
  if (name.starts_with('[') && name.ends_with(']')) name = name.substr(1, name.size() - 2);
  boost::system::error_code is_name;
  boost::asio::ip::make_address(name, is_name);
  return !is_name || name == "localhost";
}

}  // namespace orbbuf
