// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

#include "testing/simulation/world.hpp"

/// TCP between machines, as its users see it: bytes that arrive late, in order, once,
/// or not at all.
namespace orbbuf::simulation {

/// A new connection of the calling machine to another one's address, whose first packet is sent at
/// once.
int open_connection(int to, std::uint16_t port);
inline Connection& connection(int number) {
  return world->connections[static_cast<std::size_t>(number)];
}

/// How many bytes were taken; 0: no room.
std::size_t send_bytes(int number, int end, const char* bytes, std::size_t count);
/// How many bytes came; 0: none there.
std::size_t receive_bytes(int number, int end, char* into, std::size_t room, bool is_peeking);
std::size_t room_to_send(int number, int end);
/// No bytes follow.
void end_writing(int number, int end);
/// As close(2).
void close_end(int number, int end);
/// As the kernel does for a process that is gone.
void close_all(int machine);
/// Without a word: the machine has lost power.
void abandon_all(int machine);
/// The robot has another address now.
void change_address(int machine);
/// After a path, or a machine, is back: nothing to do but for what waits.
void keep_alive(int number, int end);

/// The next connection in the queue of the calling machine; -1: none.
int accept_connection();

}  // namespace orbbuf::simulation
