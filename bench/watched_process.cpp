// SPDX-License-Identifier: Apache-2.0
#include "bench/watched_process.hpp"

#include <unistd.h>

#include <ctime>
#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace orbbuf::bench {
namespace {

constexpr std::uint64_t kBytesPerKib = 1024;

}  // namespace

WatchedProcess::WatchedProcess(pid_t pid) : pid_(pid) {
  if (::clock_getcpuclockid(pid, &clock_) != 0) {
    throw std::runtime_error("no process " + std::to_string(pid));
  }
}

std::chrono::nanoseconds WatchedProcess::cpu_time() const {
  timespec time{};
  if (::clock_gettime(clock_, &time) != 0) {
    throw std::runtime_error("process " + std::to_string(pid_) + " has gone");
  }
  return std::chrono::seconds(time.tv_sec) + std::chrono::nanoseconds(time.tv_nsec);
}

std::chrono::nanoseconds WatchedProcess::waiting_time() const {
  std::chrono::nanoseconds sum{};
  for (const auto& thread :
       std::filesystem::directory_iterator("/proc/" + std::to_string(pid_) + "/task")) {
    std::ifstream in(thread.path() / "schedstat");
    std::chrono::nanoseconds::rep running = 0;
    std::chrono::nanoseconds::rep waiting = 0;
    if (in >> running >> waiting) sum += std::chrono::nanoseconds(waiting);
  }
  return sum;
}

std::uint64_t WatchedProcess::status(const std::string& key) const {
  std::ifstream in("/proc/" + std::to_string(pid_) + "/status");
  for (std::string word; in >> word;) {
    std::uint64_t kib = 0;
    if (word == key + ":" && in >> kib) return kib;
  }
  throw std::runtime_error("no " + key + " of process " + std::to_string(pid_));
}

std::uint64_t tcp_memory_kib() {
  std::ifstream in("/proc/net/sockstat");
  bool is_tcp = false;
  for (std::string word; in >> word;) {
    if (word.ends_with(':')) is_tcp = word == "TCP:";
    std::uint64_t pages = 0;
    if (is_tcp && word == "mem" && in >> pages) {
      return pages * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE)) / kBytesPerKib;
    }
  }
  throw std::runtime_error("no TCP memory in /proc/net/sockstat");
}

}  // namespace orbbuf::bench
