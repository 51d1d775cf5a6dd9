// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/bind_interface.hpp"

#include <ifaddrs.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <boost/asio/ip/tcp.hpp>
#include <cerrno>
#include <cstring>
#include <memory>

namespace orbbuf {
namespace {

namespace ip = boost::asio::ip;
using Source = ip::tcp::endpoint;

std::optional<Source> parse_source(const std::string& text) {
  boost::system::error_code is_name;
  const auto address = ip::make_address(text, is_name);
  return is_name ? std::nullopt : std::optional(Source(address, 0));
}

std::optional<Source> source_of(const std::string& interface, int family) {
  ifaddrs* found = nullptr;
  if (::getifaddrs(&found) != 0) return std::nullopt;
  const std::unique_ptr<ifaddrs, decltype(&::freeifaddrs)> owned(found, &::freeifaddrs);
  for (const ifaddrs* one = found; one != nullptr; one = one->ifa_next) {
    if (one->ifa_addr == nullptr || one->ifa_addr->sa_family != family) continue;
    if (interface != one->ifa_name) continue;
    Source source(family == AF_INET ? ip::tcp::v4() : ip::tcp::v6(), 0);
    std::memcpy(source.data(), one->ifa_addr, source.size());
    return source;
  }
  return std::nullopt;
}

/// The port is chosen at the connect: many connections may have the same one.
std::optional<Error> bind_source(int socket, const Source& source, const std::string& attempt) {
  const int yes = 1;
  ::setsockopt(socket, IPPROTO_IP, IP_BIND_ADDRESS_NO_PORT, &yes, sizeof yes);
  const auto size = static_cast<socklen_t>(source.size());
  if (::bind(socket, source.data(), size) == 0) return std::nullopt;
  return system_error(attempt, errno);
}

}  // namespace

std::optional<Error> bind_interface(int socket, int family, const std::string& interface) {
  if (const auto source = parse_source(interface)) {
    if (source->protocol().family() != family) {
      return Error{"cannot use source address " + interface +
                   ": the server's address is of the other IP version"};
    }
    return bind_source(socket, *source, "cannot use source address " + interface);
  }
  const std::string attempt = "cannot use interface " + interface;
  if (::setsockopt(socket, SOL_SOCKET, SO_BINDTODEVICE, interface.c_str(),
                   static_cast<socklen_t>(interface.size())) == 0) {
    return std::nullopt;
  }
  if (errno != EPERM) return system_error(attempt, errno);
  if (const auto source = source_of(interface, family)) {
    return bind_source(socket, *source, attempt);
  }
  return Error{attempt + ": the system allows no binding to it, and it has no address of IPv" +
               (family == AF_INET ? "4" : "6")};
}

}  // namespace orbbuf
