// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/network_news.hpp"

#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <utility>

#include "common/error.hpp"
#include "common/log.hpp"

namespace orbbuf {
namespace {

using boost::system::error_code;

constexpr std::size_t kRoom = 16384;

/// -1, and errno, if the system refuses.
int open_route_socket() {
  const int socket = ::socket(AF_NETLINK, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, NETLINK_ROUTE);
  if (socket < 0) return -1;
  sockaddr_nl address{};
  address.nl_family = AF_NETLINK;
  address.nl_groups =
      RTMGRP_LINK | RTMGRP_IPV4_IFADDR | RTMGRP_IPV4_ROUTE | RTMGRP_IPV6_IFADDR | RTMGRP_IPV6_ROUTE;
  if (::bind(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0) {
    return socket;
  }
  const int why = errno;
  ::close(socket);
  errno = why;
  return -1;
}

/// Messages that go by are no news: those of what was removed.
bool has_news(const std::array<char, kRoom>& bytes, std::size_t size) {
  const auto* message = reinterpret_cast<const nlmsghdr*>(bytes.data());
  for (; NLMSG_OK(message, size); message = NLMSG_NEXT(message, size)) {
    if (message->nlmsg_type == RTM_NEWLINK || message->nlmsg_type == RTM_NEWADDR ||
        message->nlmsg_type == RTM_NEWROUTE) {
      return true;
    }
  }
  return false;
}

}  // namespace

NetworkNews::NetworkNews(boost::asio::io_context& io, std::function<void()> changed)
    : socket_(io), changed_(std::move(changed)) {}

void NetworkNews::start() {
  const int socket = open_route_socket();
  if (socket < 0) {
    return log_info("link: {}; attempts to connect go by the clock alone",
                    system_error("no news of the network's interfaces", errno).text);
  }
  socket_.assign(socket);
  wait();
}

void NetworkNews::stop() {
  error_code ignored;  // nothing is lost with it
  socket_.close(ignored);
}

void NetworkNews::wait() {
  socket_.async_wait(boost::asio::posix::stream_descriptor::wait_read,
                     [this](const error_code& failed) {
                       if (failed || !socket_.is_open()) return;
                       if (read_all()) changed_();
                       if (socket_.is_open()) wait();
                     });
}

bool NetworkNews::read_all() {
  alignas(nlmsghdr) std::array<char, kRoom> bytes;
  bool is_news = false;
  for (;;) {
    const auto size = ::recv(socket_.native_handle(), bytes.data(), bytes.size(), 0);
    if (size < 0 && errno == ENOBUFS) is_news = true;  // there were more than the kernel keeps
    if (size < 0 && errno != ENOBUFS && errno != EINTR) return is_news;
    if (size > 0) is_news = has_news(bytes, static_cast<std::size_t>(size)) || is_news;
    if (size == 0) return is_news;
  }
}

}  // namespace orbbuf
