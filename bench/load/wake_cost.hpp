// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>

namespace orbbuf::load {

/// The CPU time of a thread that waits in epoll_wait() and, when it is woken, reads eight bytes and
/// waits again: on this machine, at this moment, no program that a message wakes can be cheaper.
/// Takes two seconds.
std::chrono::nanoseconds bare_wake_cost();

}  // namespace orbbuf::load
