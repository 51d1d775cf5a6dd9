// SPDX-License-Identifier: Apache-2.0
#include "testing/stopped_thread.hpp"

#include <sys/ptrace.h>
#include <sys/wait.h>

#include <chrono>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <thread>

#include "testing/temporary_folder.hpp"

namespace orbbuf::test {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::minutes kLongestWait{1};

std::optional<pid_t> find(pid_t process, const std::string& name) {
  if (name == "main") return process;
  const auto threads = "/proc/" + std::to_string(process) + "/task";
  for (const auto& thread : std::filesystem::directory_iterator(threads)) {
    if (read_file(thread.path() / "comm") == name + "\n")
      return std::stoi(thread.path().filename());
  }
  return std::nullopt;
}

pid_t wait_for(pid_t process, const std::string& name) {
  for (const auto end = Clock::now() + kLongestWait; Clock::now() < end;) {
    if (const auto thread = find(process, name)) return *thread;
    std::this_thread::yield();
  }
  throw std::runtime_error("no thread " + name);
}

}  // namespace

StoppedThread::StoppedThread(pid_t process, const std::string& name) {
  const pid_t thread = wait_for(process, name);
  if (::ptrace(PTRACE_SEIZE, thread, nullptr, nullptr) != 0) return;
  thread_ = thread;
  ::ptrace(PTRACE_INTERRUPT, thread_, nullptr, nullptr);
  ::waitpid(thread_, nullptr, __WALL);
}

StoppedThread::~StoppedThread() {
  if (is_stopped()) ::ptrace(PTRACE_DETACH, thread_, nullptr, nullptr);
}

}  // namespace orbbuf::test
