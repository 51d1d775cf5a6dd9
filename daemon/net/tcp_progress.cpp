// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/tcp_progress.hpp"

// The kernel's header, not the C library's <netinet/tcp.h>, whose tcp_info ends before
// tcpi_bytes_acked. Asio includes the latter, and the two cannot meet in one file.
#include <linux/tcp.h>
#include <netinet/in.h>
#include <sys/socket.h>

namespace orbbuf {

std::optional<TcpProgress> tcp_progress(int socket) {
  tcp_info info{};
  socklen_t length = sizeof info;
  if (::getsockopt(socket, IPPROTO_TCP, TCP_INFO, &info, &length) != 0) return std::nullopt;
  constexpr std::uint32_t kNoRoundTripYet = ~0U;
  const std::uint32_t least = info.tcpi_min_rtt == kNoRoundTripYet ? 0 : info.tcpi_min_rtt;
  return TcpProgress{info.tcpi_bytes_acked,
                     info.tcpi_unacked,
                     info.tcpi_notsent_bytes,
                     info.tcpi_probes,
                     std::chrono::microseconds(info.tcpi_rtt),
                     std::chrono::microseconds(least)};
}

bool limit_unsent(int socket, std::uint32_t bytes) {
  return ::setsockopt(socket, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &bytes, sizeof bytes) == 0;
}

}  // namespace orbbuf
