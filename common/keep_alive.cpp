// SPDX-License-Identifier: Apache-2.0
#include "common/keep_alive.hpp"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

namespace orbbuf {
namespace {

constexpr int kIdleSeconds = 5;
constexpr int kIntervalSeconds = 2;
constexpr int kProbes = 5;
constexpr int kTcpRtoMaxMs = 44;  // TCP_RTO_MAX_MS, newer than the headers of Debian 12 and 13
constexpr int kUnacknowledgedMs = 30'000;

bool set(int socket, int level, int option, int value) {
  return ::setsockopt(socket, level, option, &value, sizeof value) == 0;
}

}  // namespace

bool keep_alive(int socket) {
  return set(socket, IPPROTO_TCP, TCP_KEEPIDLE, kIdleSeconds) &&
         set(socket, IPPROTO_TCP, TCP_KEEPINTVL, kIntervalSeconds) &&
         set(socket, IPPROTO_TCP, TCP_KEEPCNT, kProbes) && set(socket, SOL_SOCKET, SO_KEEPALIVE, 1);
}

void limit_retransmission_interval(int socket, std::chrono::milliseconds longest) {
  set(socket, IPPROTO_TCP, kTcpRtoMaxMs, static_cast<int>(longest.count()));
}

bool limit_unacknowledged_time(int socket) {
  return set(socket, IPPROTO_TCP, TCP_USER_TIMEOUT, kUnacknowledgedMs);
}

}  // namespace orbbuf
