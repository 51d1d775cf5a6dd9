// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <string>

/// Plain, blocking TCP over IPv4, for the programs that the benches measure with and against. No
/// socket is closed: each program has one, until it ends. All throw std::system_error that says
/// what was tried.
namespace orbbuf::bench {

/// `result` of a system call, which failed if it is negative.
ssize_t check(ssize_t result, const std::string& attempt);

/// address: "10.77.0.2"; std::runtime_error if it is none. protocol: 0 for TCP, or IPPROTO_MPTCP.
int connect_to(const std::string& address, const std::string& port, int protocol = 0);

/// Waits for one connection to this address. Prints "listening" to the standard error output once
/// it can be made.
int accept_one(const std::string& address, const std::string& port, int protocol = 0);

/// Blocks until the kernel has taken all of them.
void send_all(int socket, const void* bytes, std::size_t size);

}  // namespace orbbuf::bench
