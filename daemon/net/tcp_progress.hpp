// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <optional>

namespace orbbuf {

/// How far the kernel has got with a TCP connection's sending side (tcp(7), TCP_INFO).
struct TcpProgress {
  std::uint64_t acked_bytes = 0;  ///< acknowledged by the peer's kernel since the connection opened
  std::uint32_t unacked_segments = 0;      ///< sent, not yet acknowledged
  std::uint32_t unsent_bytes = 0;          ///< accepted from us, not yet sent
  std::uint32_t unanswered_probes = 0;     ///< of a receive window that is full, since the last ack
  std::chrono::microseconds round_trip{};  ///< smoothed
  std::chrono::microseconds least_round_trip{};  ///< of the last minutes

  /// Something was sent, be it but a probe, and has yet to be acknowledged.
  bool is_waiting() const { return unacked_segments > 0 || unanswered_probes > 0; }
};

/// Nothing if `socket` is not a connected TCP socket. One system call.
std::optional<TcpProgress> tcp_progress(int socket);

/// TCP_NOTSENT_LOWAT: the kernel takes no more from us while it has this much unsent. False if the
/// system refuses.
bool limit_unsent(int socket, std::uint32_t bytes);

}  // namespace orbbuf
