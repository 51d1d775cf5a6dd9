// SPDX-License-Identifier: Apache-2.0
#include "bench/plain_socket.hpp"

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <stdexcept>
#include <system_error>

namespace orbbuf::bench {
namespace {

sockaddr_in endpoint(const std::string& address, const std::string& port) {
  sockaddr_in result{};
  result.sin_family = AF_INET;
  result.sin_port = htons(static_cast<std::uint16_t>(std::stoul(port)));
  if (::inet_pton(AF_INET, address.c_str(), &result.sin_addr) != 1) {
    throw std::runtime_error("not an IPv4 address: " + address);
  }
  return result;
}

int make_socket(int protocol) {
  return static_cast<int>(check(::socket(AF_INET, SOCK_STREAM, protocol), "socket"));
}

}  // namespace

ssize_t check(ssize_t result, const std::string& attempt) {
  if (result < 0) throw std::system_error(errno, std::generic_category(), attempt);
  return result;
}

int connect_to(const std::string& address, const std::string& port, int protocol) {
  const sockaddr_in server = endpoint(address, port);
  const int socket = make_socket(protocol);
  check(::connect(socket, reinterpret_cast<const sockaddr*>(&server), sizeof server),
        "connect to " + address);
  return socket;
}

int accept_one(const std::string& address, const std::string& port, int protocol) {
  const sockaddr_in self = endpoint(address, port);
  const int listener = make_socket(protocol);
  check(::bind(listener, reinterpret_cast<const sockaddr*>(&self), sizeof self),
        "bind to " + address);
  check(::listen(listener, 1), "listen");
  std::fputs("listening\n", stderr);
  return static_cast<int>(check(::accept(listener, nullptr, nullptr), "accept"));
}

void send_all(int socket, const void* bytes, std::size_t size) {
  const auto* at = static_cast<const char*>(bytes);
  while (size > 0) {
    const auto sent =
        static_cast<std::size_t>(check(::send(socket, at, size, MSG_NOSIGNAL), "send"));
    at += sent;
    size -= sent;
  }
}

}  // namespace orbbuf::bench
