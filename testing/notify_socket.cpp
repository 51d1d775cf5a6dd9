// SPDX-License-Identifier: Apache-2.0
#include "testing/notify_socket.hpp"

#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <array>
#include <cstring>
#include <stdexcept>

namespace orbbuf::test {

NotifySocket::NotifySocket() : socket_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string name = path();
  if (name.size() >= sizeof address.sun_path) throw std::runtime_error(name + " is too long");
  std::memcpy(address.sun_path, name.c_str(), name.size());
  if (::bind(socket_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
    throw std::runtime_error("cannot bind " + name);
  }
}

std::optional<std::string> NotifySocket::next(std::chrono::milliseconds limit) {
  pollfd event{socket_.get(), POLLIN, 0};
  if (::poll(&event, 1, static_cast<int>(limit.count())) != 1) return std::nullopt;
  std::array<char, 4096> message{};
  const auto size = ::recv(socket_.get(), message.data(), message.size(), 0);
  if (size < 0) throw std::runtime_error("cannot receive");
  return std::string(message.data(), static_cast<std::size_t>(size));
}

std::vector<std::string> NotifySocket::until(const std::string& beginning,
                                             std::chrono::milliseconds limit) {
  std::vector<std::string> messages;
  while (auto message = next(limit)) {
    messages.push_back(*message);
    if (message->starts_with(beginning)) break;
  }
  return messages;
}

}  // namespace orbbuf::test
