// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstddef>
#include <functional>
#include <stdexcept>

namespace orbbuf::test {

/// Runs `work` in a child process and stops it before each system call that could leave something
/// behind: those that give it memory do not count. `stop` gets the number of these calls so far,
/// this one included; true: the child is killed, and that call is not made. Returns whether it was
/// killed. Throws std::runtime_error if the child cannot be traced or `work` has failed.
inline bool step_child(const std::function<bool()>& work,
                       const std::function<bool(std::size_t)>& stop) {
  const pid_t child = ::fork();
  if (child == 0) {
    if (::ptrace(PTRACE_TRACEME, 0, nullptr, nullptr) != 0) ::_exit(2);
    std::raise(SIGSTOP);
    ::_exit(work() ? 0 : 1);
  }
  int status = 0;
  ::waitpid(child, &status, 0);
  constexpr auto kOptions = PTRACE_O_TRACESYSGOOD | PTRACE_O_EXITKILL;
  if (!WIFSTOPPED(status) || ::ptrace(PTRACE_SETOPTIONS, child, nullptr, kOptions) != 0) {
    throw std::runtime_error("cannot trace a child");
  }
  for (std::size_t calls = 0;;) {
    ::ptrace(PTRACE_SYSCALL, child, nullptr, nullptr);
    ::waitpid(child, &status, 0);
    if (WIFEXITED(status)) break;
    if (!WIFSTOPPED(status)) throw std::runtime_error("the child has died");
    __ptrace_syscall_info call{};
    ::ptrace(PTRACE_GET_SYSCALL_INFO, child, sizeof call, &call);
    if (call.op != PTRACE_SYSCALL_INFO_ENTRY) continue;
    const auto number = static_cast<long>(call.entry.nr);
    if (number == SYS_brk || number == SYS_mmap || number == SYS_munmap || number == SYS_mremap ||
        number == SYS_madvise || number == SYS_futex) {
      continue;
    }
    if (!stop(++calls)) continue;
    ::kill(child, SIGKILL);
    ::waitpid(child, &status, 0);
    return true;
  }
  if (WEXITSTATUS(status) != 0) throw std::runtime_error("the child has failed");
  return false;
}

}  // namespace orbbuf::test
