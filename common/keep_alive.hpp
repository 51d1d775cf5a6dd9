// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace orbbuf {

/// Sets TCP keep-alive: the kernel closes the connection when its peer has not answered for about
/// 15 s, for example because its host lost power. False if the system refuses.
bool keep_alive(int socket);

/// Has the kernel wait at most so long from one retransmission to the next, at least 1 s, where it
/// can (Linux 6.15): else it doubles that time while a link is down, up to 2 minutes, and sleeps on
/// when the link is back. With 1 s it gives the connection up after about 15 s of silence, with 4 s
/// after 45 s. Does nothing elsewhere.
void limit_retransmission_interval(int socket, std::chrono::milliseconds longest);

/// Has the kernel end a TCP connection when data that it sent has not been acknowledged for 30 s.
/// Not for an end that sends to a reader that may pause: Linux also ends a connection whose window
/// was full for that long, although the peer answers its probes. False if the system refuses.
bool limit_unacknowledged_time(int socket);

}  // namespace orbbuf
