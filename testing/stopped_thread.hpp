// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <string>
#include <vector>

namespace orbbuf::test {

/// A thread of a child process that stands still, as one that is stuck in a driver does, for as
/// long as this lives: stopped by ptrace(2). All of that name, if there are several. Thread-bound
/// to its maker.
class StoppedThread {
 public:
  /// `name`: the thread's, as the log has it, which a new one gives itself: waits for it. Throws
  /// std::runtime_error if there is none for a minute.
  StoppedThread(pid_t process, const std::string& name);
  ~StoppedThread();
  StoppedThread(const StoppedThread&) = delete;
  StoppedThread& operator=(const StoppedThread&) = delete;

  /// False where this is not permitted: then nothing was stopped.
  bool is_stopped() const { return !threads_.empty(); }

 private:
  std::vector<pid_t> threads_;
};

}  // namespace orbbuf::test
