// SPDX-License-Identifier: Apache-2.0
// Descriptors that no disk is behind: sockets, epoll, eventfd, pipes. The kernel gives only their
// numbers.
#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <ifaddrs.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <linux/sockios.h>
#include <linux/tcp.h>
#include <netdb.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdarg.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <deque>
#include <memory>
#include <utility>
#include <vector>

#include "testing/simulation/interpose.hpp"
#include "testing/simulation/network.hpp"
#include "testing/simulation/real.hpp"
#include "testing/simulation/world.hpp"

namespace orbbuf::simulation {
namespace {

enum class Kind : std::uint8_t { kSocket, kListener, kNews, kEvent, kPipe, kEpoll };

struct Watched {
  int fd = -1;
  std::uint32_t events = 0;
  epoll_data_t data{};
  bool is_new = true;
  std::uint32_t seen = 0;
};

struct PipeContent {
  std::deque<char> bytes;
  std::uint32_t changes = 0;
};

struct Descriptor {
  Kind kind = Kind::kSocket;
  bool is_non_blocking = false;
  int connection = -1;  ///< sockets: -1: not connected
  std::uint32_t generation = 0;
  int end = 0;
  std::uint32_t least_unsent = 0;  ///< set before it was connected
  bool is_kept_alive = false;
  bool resets = false;
  Time user_timeout = 0;
  std::uint16_t port = 0;
  int at = -1;              ///< bound to that machine's address; -1: its own
  std::uint64_t count = 0;  ///< eventfd
  std::uint32_t changes = 0;
  std::uint32_t news_read = 0;
  std::shared_ptr<PipeContent> pipe;
  bool writes = false;  ///< that end of a pipe
  std::vector<Watched> watched;
};

/// By their numbers. Used until the very end.
std::vector<std::unique_ptr<Descriptor>>& descriptors() {
  static auto* const all = new std::vector<std::unique_ptr<Descriptor>>();
  return *all;
}

Descriptor* find(int fd) {
  if (!is_in_machine()) return nullptr;
  const auto& all = descriptors();
  const auto place = static_cast<std::size_t>(fd);  // a negative one is beyond all
  return place < all.size() ? all[place].get() : nullptr;
}

int add(Kind kind, bool is_non_blocking) {
  const auto fd = static_cast<int>(
      raw_call(SYS_openat, AT_FDCWD, reinterpret_cast<long>("/dev/null"), O_RDWR | O_CLOEXEC));
  if (fd < 0) fail("no descriptors left");
  auto& all = descriptors();
  const auto place = static_cast<std::size_t>(fd);
  if (all.size() <= place) all.resize(place + 1);
  all[place] = std::make_unique<Descriptor>();
  all[place]->kind = kind;
  all[place]->is_non_blocking = is_non_blocking;
  return fd;
}

bool is_connected(const Descriptor& one) {
  return one.connection >= 0 && connection(one.connection).generation == one.generation;
}
Endpoint& endpoint(const Descriptor& one) {
  return connection(one.connection).ends[static_cast<std::size_t>(one.end)];
}
Half& incoming(const Descriptor& one) {
  return connection(one.connection).halves[static_cast<std::size_t>(1 - one.end)];
}
Half& outgoing(const Descriptor& one) {
  return connection(one.connection).halves[static_cast<std::size_t>(one.end)];
}

std::uint32_t socket_readiness(const Descriptor& one) {
  if (!is_connected(one)) return EPOLLOUT | EPOLLHUP;
  const Endpoint& end = endpoint(one);
  if (end.error != 0) return EPOLLIN | EPOLLOUT | EPOLLERR | EPOLLHUP;
  std::uint32_t ready = 0;
  if (incoming(one).readable() > 0 || incoming(one).is_at_end()) ready |= EPOLLIN;
  if (incoming(one).is_at_end()) ready |= EPOLLRDHUP;
  if (end.is_established && room_to_send(one.connection, one.end) > 0) ready |= EPOLLOUT;
  return ready;
}

std::uint32_t readiness(const Descriptor& one) {
  constexpr std::uint32_t kIn = EPOLLIN, kOut = EPOLLOUT;
  switch (one.kind) {
    case Kind::kSocket:
      return socket_readiness(one);
    case Kind::kListener:
      return my_machine().listener.queue_used > 0 ? kIn : 0;
    case Kind::kNews:
      return my_machine().network_news != one.news_read ? kIn : 0;
    case Kind::kEvent:
      return one.count > 0 ? kIn | kOut : kOut;
    case Kind::kPipe:
      return one.writes ? kOut : one.pipe->bytes.empty() ? 0 : kIn;
    case Kind::kEpoll:
      return 0;
  }
  return 0;
}

std::uint32_t changes(const Descriptor& one) {
  switch (one.kind) {
    case Kind::kSocket:
      return is_connected(one) ? endpoint(one).changes : 0;
    case Kind::kListener:
      return my_machine().listener.changes;
    case Kind::kNews:
      return my_machine().network_news;
    case Kind::kEvent:
      return one.changes;
    case Kind::kPipe:
      return one.pipe->changes;
    case Kind::kEpoll:
      return 0;
  }
  return 0;
}

ssize_t failed(int error) {
  errno = error;
  return -1;
}

/// True: try again; false: EAGAIN.
bool wait_for(const Descriptor& one) {
  if (one.is_non_blocking) return false;
  block(Wait::kIo, nullptr, kNever);
  return true;
}

ssize_t receive(int fd, const iovec* parts, std::size_t count, int flags) {
  for (;;) {
    Descriptor& one = *find(fd);
    if (!is_connected(one)) return failed(ENOTCONN);
    Endpoint& end = endpoint(one);
    std::size_t taken = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t got =
          receive_bytes(one.connection, one.end, static_cast<char*>(parts[i].iov_base),
                        parts[i].iov_len, (flags & MSG_PEEK) != 0);
      taken += got;
      if (got < parts[i].iov_len) break;
    }
    if (taken > 0) return static_cast<ssize_t>(taken);
    if (end.error != 0) return failed(std::exchange(end.error, ENOTCONN));
    if (incoming(one).is_at_end()) return 0;
    if ((flags & MSG_DONTWAIT) != 0 || !wait_for(one)) return failed(EAGAIN);
  }
}

ssize_t transmit(int fd, const iovec* parts, std::size_t count, int flags) {
  interruption_point();
  for (;;) {
    Descriptor& one = *find(fd);
    if (!is_connected(one)) return failed(ENOTCONN);
    Endpoint& end = endpoint(one);
    if (end.error != 0) return failed(end.error == ECONNRESET ? EPIPE : end.error);
    if (outgoing(one).has_end) return failed(EPIPE);
    std::size_t taken = 0;
    bool is_empty = true;
    if (end.is_established) {
      for (std::size_t i = 0; i < count; ++i) {
        is_empty = is_empty && parts[i].iov_len == 0;
        const std::size_t sent = send_bytes(
            one.connection, one.end, static_cast<const char*>(parts[i].iov_base), parts[i].iov_len);
        taken += sent;
        if (sent < parts[i].iov_len) break;
      }
    } else {
      is_empty = false;
    }
    if (taken > 0 || is_empty) return static_cast<ssize_t>(taken);
    end.wants_room = true;
    if ((flags & MSG_DONTWAIT) != 0 || !wait_for(one)) return failed(EAGAIN);
  }
}

ssize_t receive_news(Descriptor& one, void* into, std::size_t room) {
  if (my_machine().network_news == one.news_read) return failed(EAGAIN);
  one.news_read = my_machine().network_news;
  nlmsghdr message{};
  message.nlmsg_len = NLMSG_LENGTH(0);
  message.nlmsg_type = RTM_NEWADDR;
  std::memcpy(into, &message, std::min(room, sizeof message));
  return sizeof message;
}

ssize_t read_pipe(int fd, void* into, std::size_t room) {
  for (;;) {
    Descriptor& one = *find(fd);
    auto& bytes = one.pipe->bytes;
    if (!bytes.empty()) {
      const std::size_t taken = std::min(room, bytes.size());
      std::copy_n(bytes.begin(), taken, static_cast<char*>(into));
      bytes.erase(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(taken));
      return static_cast<ssize_t>(taken);
    }
    if (!wait_for(one)) return failed(EAGAIN);
  }
}

ssize_t read_event(int fd, void* into) {
  for (;;) {
    Descriptor& one = *find(fd);
    if (one.count > 0) {
      std::memcpy(into, &one.count, sizeof one.count);
      one.count = 0;
      return sizeof one.count;
    }
    if (!wait_for(one)) return failed(EAGAIN);
  }
}

sockaddr_in address_of(int machine_number, std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(0x0A000001U + (static_cast<std::uint32_t>(machine_number) << 8U));
  return address;
}

/// Whose address that is; -1: of none.
int machine_at(const sockaddr_in& address) {
  for (int i = 0; i < kMostMachines; ++i) {
    if (address_of(i, 0).sin_addr.s_addr == address.sin_addr.s_addr && machine(i).name[0] != 0)
      return i;
  }
  return -1;
}

int give_address(const sockaddr_in& from, sockaddr* address, socklen_t* length) {
  if (address == nullptr || length == nullptr) return 0;
  std::memcpy(address, &from, std::min<std::size_t>(*length, sizeof from));
  *length = sizeof from;
  return 0;
}

void apply_options(Descriptor& one) {
  Endpoint& end = endpoint(one);
  end.least_unsent = one.least_unsent;
  end.user_timeout = one.user_timeout;
  end.resets = one.resets;
  if (one.is_kept_alive) keep_alive(one.connection, one.end);
}

int give_value(const void* from, std::size_t size, void* value, socklen_t* length) {
  std::memcpy(value, from, std::min<std::size_t>(size, *length));
  *length = static_cast<socklen_t>(std::min<std::size_t>(size, *length));
  return 0;
}

int tcp_information(const Descriptor& one, void* value, socklen_t* length) {
  tcp_info info{};
  if (is_connected(one)) {
    constexpr std::uint64_t kSegment = 1448;
    const Half& out = outgoing(one);
    const Path& path = world->paths[static_cast<std::size_t>(connection(one.connection).path)];
    info.tcpi_bytes_acked = std::min(out.acked, out.written);
    info.tcpi_unacked =
        static_cast<std::uint32_t>((out.sent - out.acked + kSegment - 1) / kSegment);
    info.tcpi_notsent_bytes =
        static_cast<std::uint32_t>(out.written - std::min(out.sent, out.written));
    info.tcpi_rtt = static_cast<std::uint32_t>(2 * path.delay / kMicrosecond);
    info.tcpi_min_rtt = info.tcpi_rtt;
    info.tcpi_snd_mss = kSegment;
  }
  return give_value(&info, sizeof info, value, length);
}

int ready_events(Descriptor& epoll, epoll_event* events, int most) {
  int count = 0;
  for (Watched& one : epoll.watched) {
    if (count == most) break;
    const Descriptor* const descriptor = find(one.fd);
    if (descriptor == nullptr) continue;
    const bool is_edge = (one.events & EPOLLET) != 0;
    const std::uint32_t now = changes(*descriptor);
    if (is_edge && !one.is_new && one.seen == now) continue;
    one.is_new = false;
    one.seen = now;
    const std::uint32_t ready = readiness(*descriptor) & (one.events | EPOLLERR | EPOLLHUP);
    if (ready == 0) continue;
    events[count].events = ready;
    events[count].data = one.data;
    ++count;
  }
  return count;
}

/// A program that waits for a moment rounds the time down to whole milliseconds: it is woken after
/// that moment, so that it need not wait again.
Time deadline_after(int timeout_ms) {
  if (timeout_ms < 0) return kNever;
  return world->now + (timeout_ms == 0 ? 0 : (timeout_ms + 1) * kMillisecond);
}

short poll_readiness(const pollfd& one) {
  const Descriptor* const descriptor = find(one.fd);
  if (descriptor == nullptr) return one.events;  // files, and the log
  return static_cast<short>(readiness(*descriptor) &
                            (static_cast<std::uint32_t>(one.events) | EPOLLERR | EPOLLHUP));
}

}  // namespace

bool is_simulated(int fd) { return find(fd) != nullptr; }

ssize_t simulated_input(int fd, const iovec* parts, std::size_t count, int flags) {
  Descriptor& one = *find(fd);
  switch (one.kind) {
    case Kind::kSocket:
      return receive(fd, parts, count, flags);
    case Kind::kNews:
      return receive_news(one, parts->iov_base, parts->iov_len);
    case Kind::kEvent:
      return read_event(fd, parts->iov_base);
    case Kind::kPipe:
      return read_pipe(fd, parts->iov_base, parts->iov_len);
    default:
      return failed(EINVAL);
  }
}

ssize_t simulated_output(int fd, const iovec* parts, std::size_t count, int flags) {
  Descriptor& one = *find(fd);
  switch (one.kind) {
    case Kind::kSocket:
      return transmit(fd, parts, count, flags);
    case Kind::kEvent: {
      std::uint64_t more = 0;
      std::memcpy(&more, parts->iov_base, sizeof more);
      one.count += more;
      ++one.changes;
      wake_io(my_machine_number());
      interruption_point();
      return sizeof more;
    }
    case Kind::kPipe: {
      const auto* const bytes = static_cast<const char*>(parts->iov_base);
      one.pipe->bytes.insert(one.pipe->bytes.end(), bytes, bytes + parts->iov_len);
      ++one.pipe->changes;
      wake_io(my_machine_number());
      return static_cast<ssize_t>(parts->iov_len);
    }
    default:
      return failed(EINVAL);
  }
}

void forget_descriptor(int fd) {
  if (find(fd) == nullptr) return;
  const auto forgotten = std::move(descriptors()[static_cast<std::size_t>(fd)]);
  const Descriptor& one = *forgotten;
  if (one.kind == Kind::kSocket && is_connected(one)) close_end(one.connection, one.end);
  if (one.kind == Kind::kListener) my_machine().listener.port = 0;
  for (const auto& other : descriptors()) {
    if (!other) continue;
    std::erase_if(other->watched, [fd](const Watched& watched) { return watched.fd == fd; });
  }
}

}  // namespace orbbuf::simulation

using namespace orbbuf::simulation;  // NOLINT: what follows are the C library's names

ORBBUF_INTERPOSE(int, socket, int family, int type, int protocol) {
  ORBBUF_REAL(int (*)(int, int, int), "socket");
  if (!is_in_machine()) return real_function(family, type, protocol);
  const bool is_non_blocking = (type & SOCK_NONBLOCK) != 0;
  if (family == AF_INET) return add(Kind::kSocket, is_non_blocking);
  if (family == AF_NETLINK) {
    const int fd = add(Kind::kNews, is_non_blocking);
    find(fd)->news_read = my_machine().network_news;
    return fd;
  }
  return static_cast<int>(failed(EAFNOSUPPORT));
}
ORBBUF_INTERPOSE(int, bind, int fd, const sockaddr* address, socklen_t length) {
  ORBBUF_REAL(int (*)(int, const sockaddr*, socklen_t), "bind");
  Descriptor* const one = find(fd);
  if (one == nullptr) return real_function(fd, address, length);
  if (address->sa_family == AF_INET) {
    const auto& its = *reinterpret_cast<const sockaddr_in*>(address);
    one->port = ntohs(its.sin_port);
    one->at = machine_at(its);
  }
  return 0;
}
ORBBUF_INTERPOSE(int, listen, int fd, int most) {
  ORBBUF_REAL(int (*)(int, int), "listen");
  Descriptor* const one = find(fd);
  if (one == nullptr) return real_function(fd, most);
  one->kind = Kind::kListener;
  my_machine().listener.port = one->port;
  const int at = one->at < 0 ? my_machine_number() : one->at;  // a stranger takes another's address
  world->at_address[static_cast<std::size_t>(at)] = my_machine_number();
  return 0;
}
ORBBUF_INTERPOSE(int, accept4, int fd, sockaddr* address, socklen_t* length, int flags) {
  ORBBUF_REAL(int (*)(int, sockaddr*, socklen_t*, int), "accept4");
  if (find(fd) == nullptr) return real_function(fd, address, length, flags);
  interruption_point();
  for (;;) {
    const int number = accept_connection();
    if (number >= 0) {
      const int made = add(Kind::kSocket, (flags & SOCK_NONBLOCK) != 0);
      Descriptor& one = *find(made);
      one.connection = number;
      one.generation = connection(number).generation;
      one.end = 1;
      give_address(address_of(connection(number).path, connection(number).port), address, length);
      return made;
    }
    if (!wait_for(*find(fd))) return static_cast<int>(failed(EAGAIN));
  }
}
ORBBUF_INTERPOSE(int, accept, int fd, sockaddr* address, socklen_t* length) {
  return simulated_accept4(fd, address, length, 0);
}
ORBBUF_INTERPOSE(int, connect, int fd, const sockaddr* address, socklen_t length) {
  ORBBUF_REAL(int (*)(int, const sockaddr*, socklen_t), "connect");
  Descriptor* const one = find(fd);
  if (one == nullptr) return real_function(fd, address, length);
  interruption_point();
  const auto& to = *reinterpret_cast<const sockaddr_in*>(address);
  const int other = machine_at(to);
  one->connection = open_connection(std::max(other, 0), ntohs(to.sin_port));
  connection(one->connection).is_dead = other < 0;  // nothing answers
  one->generation = connection(one->connection).generation;
  apply_options(*one);
  if (one->is_non_blocking) return static_cast<int>(failed(EINPROGRESS));
  while (!endpoint(*one).is_established && endpoint(*one).error == 0) {
    block(Wait::kIo, nullptr, kNever);
  }
  if (endpoint(*one).error != 0) return static_cast<int>(failed(endpoint(*one).error));
  return 0;
}
ORBBUF_INTERPOSE(int, shutdown, int fd, int how) {
  ORBBUF_REAL(int (*)(int, int), "shutdown");
  Descriptor* const one = find(fd);
  if (one == nullptr) return real_function(fd, how);
  if (one->kind != Kind::kSocket || !is_connected(*one) || !endpoint(*one).is_established) {
    return static_cast<int>(failed(ENOTCONN));
  }
  if (how != SHUT_RD) end_writing(one->connection, one->end);
  return 0;
}
ORBBUF_INTERPOSE(int, getsockname, int fd, sockaddr* address, socklen_t* length) {
  ORBBUF_REAL(int (*)(int, sockaddr*, socklen_t*), "getsockname");
  Descriptor* const one = find(fd);
  if (one == nullptr) return real_function(fd, address, length);
  const bool is_opener = one->kind == Kind::kSocket && is_connected(*one) && one->end == 0;
  const auto port = is_opener ? connection(one->connection).port : one->port;
  return give_address(address_of(my_machine_number(), port), address, length);
}
ORBBUF_INTERPOSE(int, getpeername, int fd, sockaddr* address, socklen_t* length) {
  ORBBUF_REAL(int (*)(int, sockaddr*, socklen_t*), "getpeername");
  Descriptor* const one = find(fd);
  if (one == nullptr) return real_function(fd, address, length);
  if (!is_connected(*one)) return static_cast<int>(failed(ENOTCONN));
  const Connection& its = connection(one->connection);
  return give_address(
      one->end == 1 ? address_of(its.path, its.port) : address_of(its.to, its.to_port), address,
      length);
}
ORBBUF_INTERPOSE(int, setsockopt, int fd, int level, int option, const void* value,
                 socklen_t length) {
  ORBBUF_REAL(int (*)(int, int, int, const void*, socklen_t), "setsockopt");
  Descriptor* const one = find(fd);
  if (one == nullptr) return real_function(fd, level, option, value, length);
  if (one->kind != Kind::kSocket) return 0;
  int number = 0;
  std::memcpy(&number, value, std::min<std::size_t>(length, sizeof number));
  constexpr int kMostRetransmissionInterval = 44;  // of Linux 6.15, which this is not
  if (level == IPPROTO_TCP && option == kMostRetransmissionInterval) {
    return static_cast<int>(failed(ENOPROTOOPT));
  }
  if (level == IPPROTO_TCP && option == TCP_NOTSENT_LOWAT) {
    one->least_unsent = static_cast<std::uint32_t>(number);
  }
  if (level == IPPROTO_TCP && option == TCP_USER_TIMEOUT) one->user_timeout = number * kMillisecond;
  if (level == SOL_SOCKET && option == SO_KEEPALIVE) one->is_kept_alive = number != 0;
  if (level == SOL_SOCKET && option == SO_LINGER) {
    linger how{};
    std::memcpy(&how, value, std::min<std::size_t>(length, sizeof how));
    one->resets = how.l_onoff != 0 && how.l_linger == 0;
  }
  if (is_connected(*one)) apply_options(*one);
  return 0;
}
ORBBUF_INTERPOSE(int, getsockopt, int fd, int level, int option, void* value, socklen_t* length) {
  ORBBUF_REAL(int (*)(int, int, int, void*, socklen_t*), "getsockopt");
  Descriptor* const one = find(fd);
  if (one == nullptr) return real_function(fd, level, option, value, length);
  if (level == IPPROTO_TCP && option == TCP_INFO) return tcp_information(*one, value, length);
  int number = 0;
  if (level == SOL_SOCKET && option == SO_ERROR && is_connected(*one)) {
    number = std::exchange(endpoint(*one).error, 0);
    if (number != 0) endpoint(*one).error = ENOTCONN;
    if (number == ENOTCONN) number = 0;
  }
  if (level == SOL_SOCKET && option == SO_TYPE) number = SOCK_STREAM;
  if (level == IPPROTO_TCP && option == TCP_MAXSEG) number = 1448;
  if (level == SOL_SOCKET && (option == SO_RCVBUF || option == SO_SNDBUF)) number = kRingBytes;
  return give_value(&number, sizeof number, value, length);
}
ORBBUF_INTERPOSE(int, ioctl, int fd, unsigned long request, ...) {
  va_list list;
  va_start(list, request);
  void* const value = va_arg(list, void*);
  va_end(list);
  ORBBUF_REAL(int (*)(int, unsigned long, ...), "ioctl");
  Descriptor* const one = find(fd);
  if (one == nullptr) return real_function(fd, request, value);
  if (request == FIONBIO) {
    one->is_non_blocking = *static_cast<int*>(value) != 0;
  } else if (request == FIONREAD) {
    *static_cast<int*>(value) =
        is_connected(*one) ? static_cast<int>(incoming(*one).readable()) : 0;
  } else if (request == SIOCOUTQ) {
    const Half& out = outgoing(*one);
    *static_cast<int*>(value) = static_cast<int>(out.written - std::min(out.acked, out.written));
  } else {
    return static_cast<int>(failed(ENOTTY));
  }
  return 0;
}
extern "C" int simulated_fcntl(int fd, int command, ...) __asm__("fcntl");
extern "C" int simulated_fcntl(int fd, int command, ...) {
  va_list list;
  va_start(list, command);
  const long value = va_arg(list, long);
  va_end(list);
  Descriptor* const one = find(fd);
  if (one == nullptr) return static_cast<int>(raw_call(SYS_fcntl, fd, command, value));
  if (command == F_GETFL) return O_RDWR | (one->is_non_blocking ? O_NONBLOCK : 0);
  if (command == F_SETFL) one->is_non_blocking = (value & O_NONBLOCK) != 0;
  return 0;
}
extern "C" int simulated_fcntl64(int fd, int command, ...) __asm__("fcntl64");
extern "C" int simulated_fcntl64(int fd, int command, ...) {
  va_list list;
  va_start(list, command);
  const long value = va_arg(list, long);
  va_end(list);
  return simulated_fcntl(fd, command, value);
}
ORBBUF_INTERPOSE(ssize_t, recvmsg, int fd, msghdr* message, int flags) {
  ORBBUF_REAL(ssize_t(*)(int, msghdr*, int), "recvmsg");
  if (!is_simulated(fd)) return real_function(fd, message, flags);
  return simulated_input(fd, message->msg_iov, message->msg_iovlen, flags);
}
ORBBUF_INTERPOSE(ssize_t, sendmsg, int fd, const msghdr* message, int flags) {
  ORBBUF_REAL(ssize_t(*)(int, const msghdr*, int), "sendmsg");
  if (!is_simulated(fd)) return real_function(fd, message, flags);
  return simulated_output(fd, message->msg_iov, message->msg_iovlen, flags);
}
ORBBUF_INTERPOSE(ssize_t, recv, int fd, void* into, size_t room, int flags) {
  ORBBUF_REAL(ssize_t(*)(int, void*, size_t, int), "recv");
  if (!is_simulated(fd)) return real_function(fd, into, room, flags);
  const iovec part{into, room};
  return simulated_input(fd, &part, 1, flags);
}
ORBBUF_INTERPOSE(ssize_t, send, int fd, const void* bytes, size_t count, int flags) {
  ORBBUF_REAL(ssize_t(*)(int, const void*, size_t, int), "send");
  if (!is_simulated(fd)) return real_function(fd, bytes, count, flags);
  const iovec part{const_cast<void*>(bytes), count};
  return simulated_output(fd, &part, 1, flags);
}
ORBBUF_INTERPOSE(int, epoll_create1, int flags) {
  ORBBUF_REAL(int (*)(int), "epoll_create1");
  return is_in_machine() ? add(Kind::kEpoll, false) : real_function(flags);
}
ORBBUF_INTERPOSE(int, timerfd_create, int clock, int flags) {
  ORBBUF_REAL(int (*)(int, int), "timerfd_create");
  if (!is_in_machine()) return real_function(clock, flags);
  return static_cast<int>(failed(EMFILE));  // Asio then has epoll_wait wait for its timers
}
ORBBUF_INTERPOSE(int, epoll_ctl, int epoll, int command, int fd, epoll_event* event) {
  ORBBUF_REAL(int (*)(int, int, int, epoll_event*), "epoll_ctl");
  Descriptor* const one = find(epoll);
  if (one == nullptr) return real_function(epoll, command, fd, event);
  if (!is_simulated(fd)) return static_cast<int>(failed(EPERM));
  auto& all = one->watched;
  const auto found = std::find_if(all.begin(), all.end(),
                                  [fd](const Watched& watched) { return watched.fd == fd; });
  if (command == EPOLL_CTL_DEL) {
    if (found == all.end()) return static_cast<int>(failed(ENOENT));
    all.erase(found);
    return 0;
  }
  if ((found == all.end()) != (command == EPOLL_CTL_ADD)) {
    return static_cast<int>(failed(found == all.end() ? ENOENT : EEXIST));
  }
  Watched& watched = found == all.end() ? all.emplace_back() : *found;
  watched.fd = fd;
  watched.events = event->events;
  watched.data = event->data;
  watched.is_new = true;
  wake_io(my_machine_number());
  return 0;
}
ORBBUF_INTERPOSE(int, epoll_wait, int epoll, epoll_event* events, int most, int timeout_ms) {
  ORBBUF_REAL(int (*)(int, epoll_event*, int, int), "epoll_wait");
  if (!is_simulated(epoll)) return real_function(epoll, events, most, timeout_ms);
  const Time deadline = deadline_after(timeout_ms);
  for (;;) {
    if (const int count = ready_events(*find(epoll), events, most); count > 0) return count;
    if (deadline <= world->now) return 0;
    block(Wait::kIo, nullptr, deadline);
  }
}
ORBBUF_INTERPOSE(int, poll, pollfd* all, nfds_t count, int timeout_ms) {
  ORBBUF_REAL(int (*)(pollfd*, nfds_t, int), "poll");
  if (!is_in_machine()) return real_function(all, count, timeout_ms);
  const Time deadline = deadline_after(timeout_ms);
  for (;;) {
    int ready = 0;
    for (nfds_t i = 0; i < count; ++i) {
      all[i].revents = all[i].fd < 0 ? short{0} : poll_readiness(all[i]);
      if (all[i].revents != 0) ++ready;
    }
    if (ready > 0 || deadline <= world->now) return ready;
    block(Wait::kIo, nullptr, deadline);
  }
}
ORBBUF_INTERPOSE(int, eventfd, unsigned count, int flags) {
  ORBBUF_REAL(int (*)(unsigned, int), "eventfd");
  if (!is_in_machine()) return real_function(count, flags);
  const int fd = add(Kind::kEvent, (flags & EFD_NONBLOCK) != 0);
  find(fd)->count = count;
  return fd;
}
ORBBUF_INTERPOSE(int, eventfd_write, int fd, eventfd_t value) {
  ORBBUF_REAL(int (*)(int, eventfd_t), "eventfd_write");
  if (!is_simulated(fd)) return real_function(fd, value);
  const iovec part{&value, sizeof value};
  return simulated_output(fd, &part, 1, 0) == sizeof value ? 0 : -1;
}
ORBBUF_INTERPOSE(int, eventfd_read, int fd, eventfd_t* value) {
  ORBBUF_REAL(int (*)(int, eventfd_t*), "eventfd_read");
  if (!is_simulated(fd)) return real_function(fd, value);
  const iovec part{value, sizeof *value};
  return simulated_input(fd, &part, 1, 0) == sizeof *value ? 0 : -1;
}
ORBBUF_INTERPOSE(int, pipe2, int* fds, int flags) {
  ORBBUF_REAL(int (*)(int*, int), "pipe2");
  if (!is_in_machine()) return real_function(fds, flags);
  const auto content = std::make_shared<PipeContent>();
  for (int i = 0; i < 2; ++i) {
    fds[i] = add(Kind::kPipe, (flags & O_NONBLOCK) != 0);
    find(fds[i])->pipe = content;
    find(fds[i])->writes = i == 1;
  }
  return 0;
}
ORBBUF_INTERPOSE(int, pipe, int* fds) { return simulated_pipe2(fds, 0); }
/// Names have no address.
ORBBUF_INTERPOSE(int, getaddrinfo, const char* name, const char* service, const addrinfo* hints,
                 addrinfo** found) {
  ORBBUF_REAL(int (*)(const char*, const char*, const addrinfo*, addrinfo**), "getaddrinfo");
  in_addr number{};
  const bool is_number = name == nullptr || ::inet_pton(AF_INET, name, &number) == 1;
  if (!is_in_machine() || is_number) return real_function(name, service, hints, found);
  interruption_point();
  return EAI_NONAME;
}
ORBBUF_INTERPOSE(int, getifaddrs, ifaddrs** found) {
  ORBBUF_REAL(int (*)(ifaddrs**), "getifaddrs");
  if (!is_in_machine()) return real_function(found);
  *found = nullptr;
  return 0;
}
