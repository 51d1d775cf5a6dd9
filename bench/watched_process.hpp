// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <chrono>
#include <cstdint>
#include <string>

namespace orbbuf::bench {

/// What the kernel knows of another process. Each call throws std::runtime_error if there is none.
class WatchedProcess {
 public:
  explicit WatchedProcess(pid_t pid);

  std::uint64_t resident_kib() const { return status("VmRSS"); }
  /// The most that was resident at any time.
  std::uint64_t peak_kib() const { return status("VmHWM"); }
  /// Of all its threads, user and system.
  std::chrono::nanoseconds cpu_time() const;
  /// How long its threads of the moment, taken together, were ready to run and had no processor.
  std::chrono::nanoseconds waiting_time() const;

 private:
  std::uint64_t status(const std::string& key) const;

  const pid_t pid_;
  clockid_t clock_{};
};

/// What the machine's TCP sockets hold at the moment, both directions, those of all processes.
std::uint64_t tcp_memory_kib();

}  // namespace orbbuf::bench
