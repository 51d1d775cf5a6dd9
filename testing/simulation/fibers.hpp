// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

/// The threads of a machine take turns on its first kernel thread: passing a turn by the kernel
/// takes longer than what most turns do. The C library makes each thread as ever, with its stack
/// and its thread-local memory. The kernel thread that comes with it lends both and sleeps, until
/// it gets them back at the thread's end.
namespace orbbuf::simulation {

struct Fiber {
  void* stack_top = nullptr;      ///< where its registers are while it does not run
  std::uint32_t is_lent = 0;      ///< a futex
  std::uint32_t is_returned = 0;  ///< likewise
};

/// Lends the calling kernel thread's stack and thread-local memory, and sleeps until give_back().
/// Returns on the first kernel thread, when that switches to the fiber.
extern "C" void orbbuf_lend(Fiber* fiber);
/// Returns when something switches to `from`, or gives it back; then on its own kernel thread.
extern "C" void orbbuf_switch(Fiber* from, const Fiber* to);
/// Blocks until the fiber's kernel thread has lent it.
void await_loan(Fiber& fiber);
/// To its kernel thread. It must not be running.
void give_back(Fiber& fiber);

}  // namespace orbbuf::simulation
