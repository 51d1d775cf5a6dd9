// SPDX-License-Identifier: Apache-2.0
#include "testing/stopped_thread.hpp"

#include <sys/ptrace.h>
#include <sys/wait.h>

#include <chrono>
#include <filesystem>
#include <stdexcept>
#include <thread>
#include <vector>

#include "testing/temporary_folder.hpp"

namespace orbbuf::test {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::minutes kLongestWait{1};

std::vector<pid_t> find(pid_t process, const std::string& name) {
  if (name == "main") return {process};
  std::vector<pid_t> found;
  const auto threads = "/proc/" + std::to_string(process) + "/task";
  for (const auto& thread : std::filesystem::directory_iterator(threads)) {
    if (read_file(thread.path() / "comm") == name + "\n")
      found.push_back(std::stoi(thread.path().filename()));
  }
  return found;
}

std::vector<pid_t> wait_for(pid_t process, const std::string& name) {
  for (const auto end = Clock::now() + kLongestWait; Clock::now() < end;) {
    if (auto threads = find(process, name); !threads.empty()) return threads;
    std::this_thread::yield();
  }
  throw std::runtime_error("no thread " + name);
}

}  // namespace

StoppedThread::StoppedThread(pid_t process, const std::string& name) {
  for (const pid_t thread : wait_for(process, name)) {
    if (::ptrace(PTRACE_SEIZE, thread, nullptr, nullptr) != 0) return;
    threads_.push_back(thread);
    ::ptrace(PTRACE_INTERRUPT, thread, nullptr, nullptr);
    ::waitpid(thread, nullptr, __WALL);
  }
}

StoppedThread::~StoppedThread() {
  for (const pid_t thread : threads_) ::ptrace(PTRACE_DETACH, thread, nullptr, nullptr);
}

}  // namespace orbbuf::test
