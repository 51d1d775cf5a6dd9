// SPDX-License-Identifier: Apache-2.0
#include "common/keep_alive.hpp"

#include <gtest/gtest.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

namespace orbbuf {
namespace {

int option(int socket, int level, int name) {
  int value = -1;
  socklen_t length = sizeof value;
  EXPECT_EQ(::getsockopt(socket, level, name, &value, &length), 0);
  return value;
}

TEST(KeepAlive, ASilentPeerIsGivenUpWithinFifteenSeconds) {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  ASSERT_TRUE(keep_alive(socket));
  EXPECT_EQ(option(socket, SOL_SOCKET, SO_KEEPALIVE), 1);
  const int silence =
      option(socket, IPPROTO_TCP, TCP_KEEPIDLE) +
      option(socket, IPPROTO_TCP, TCP_KEEPINTVL) * option(socket, IPPROTO_TCP, TCP_KEEPCNT);
  EXPECT_EQ(silence, 15);
  ::close(socket);
}

TEST(KeepAlive, WhatIsNoTcpSocketIsRefused) {
  const int socket = ::socket(AF_UNIX, SOCK_STREAM, 0);
  EXPECT_FALSE(keep_alive(socket));
  EXPECT_FALSE(limit_unacknowledged_time(socket));
  ::close(socket);
}

TEST(KeepAlive, UnacknowledgedDataIsGivenUpAfterThirtySeconds) {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  ASSERT_TRUE(limit_unacknowledged_time(socket));
  EXPECT_EQ(option(socket, IPPROTO_TCP, TCP_USER_TIMEOUT), 30'000);
  ::close(socket);
}

TEST(KeepAlive, RetransmissionsAreAtMostSoFarApartWhereTheKernelCanDoThat) {
  constexpr int kTcpRtoMaxMs = 44;
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  int before = 0;
  socklen_t length = sizeof before;
  if (::getsockopt(socket, IPPROTO_TCP, kTcpRtoMaxMs, &before, &length) != 0) {
    ::close(socket);
    GTEST_SKIP() << "Linux has TCP_RTO_MAX_MS since 6.15";
  }
  for (const int longest : {1000, 4000}) {
    limit_retransmission_interval(socket, std::chrono::milliseconds(longest));
    EXPECT_EQ(option(socket, IPPROTO_TCP, kTcpRtoMaxMs), longest);
  }
  ::close(socket);
}

}  // namespace
}  // namespace orbbuf
