// SPDX-License-Identifier: Apache-2.0
#include "server/sink/child_process.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <spdlog/spdlog.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <boost/asio/posix/stream_descriptor.hpp>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <string_view>
#include <utility>

namespace orbbuf {
namespace {

namespace asio = boost::asio;

constexpr int kFirstDescriptorToClose = 3;

/// How a waitpid() status reads in a log line.
std::string exit_text(int status) {
  if (WIFEXITED(status)) return fmt::format("exited with status {}", WEXITSTATUS(status));
  const int signal = WTERMSIG(status);
  return fmt::format("was killed by signal {} ({})", signal, ::strsignal(signal));
}

std::string_view variable(std::string_view entry) { return entry.substr(0, entry.find('=')); }

/// `ours` first, and of the server's own what is not among it.
std::vector<std::string> merged_environment(const std::vector<std::string>& ours) {
  std::vector<std::string> merged = ours;
  for (char** entry = environ; *entry != nullptr; ++entry) {
    bool is_ours = false;
    for (const auto& own : ours) is_ours = is_ours || variable(own) == variable(*entry);
    if (!is_ours) merged.emplace_back(*entry);
  }
  return merged;
}

/// As exec wants them; `texts` must stay as they are.
std::vector<char*> c_strings(std::vector<std::string>& texts) {
  std::vector<char*> pointers;
  pointers.reserve(texts.size() + 1);
  for (auto& text : texts) pointers.push_back(text.data());
  pointers.push_back(nullptr);
  return pointers;
}

/// Starts `sh -c command` with `input` as its standard input. Zero or an errno value.
int spawn(const std::string& command, std::vector<std::string> environment, int input, pid_t* pid) {
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  sigset_t defaults;
  sigemptyset(&defaults);
  sigaddset(&defaults, SIGPIPE);
  if (int failed = posix_spawn_file_actions_init(&actions)) return failed;
  int failed = posix_spawnattr_init(&attributes);
  if (failed == 0) {
    posix_spawnattr_setsigdefault(&attributes, &defaults);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
    failed = posix_spawn_file_actions_adddup2(&actions, input, STDIN_FILENO);
    if (failed == 0) {
      failed = posix_spawn_file_actions_addclosefrom_np(&actions, kFirstDescriptorToClose);
    }
    std::vector<std::string> arguments{"sh", "-c", command};
    if (failed == 0) {
      failed = ::posix_spawn(pid, "/bin/sh", &actions, &attributes, c_strings(arguments).data(),
                             c_strings(environment).data());
    }
    posix_spawnattr_destroy(&attributes);
  }
  posix_spawn_file_actions_destroy(&actions);
  return failed;
}

}  // namespace

/// A running child; the wait for its end keeps it alive.
struct ChildProcess::Child : std::enable_shared_from_this<Child> {
  Child(asio::io_context& main, std::string child_name, pid_t child_pid, int pidfd,
        std::shared_ptr<std::string> exit)
      : name(std::move(child_name)), pid(child_pid), end(main, pidfd), last_exit(std::move(exit)) {}

  void wait() {
    end.async_wait(asio::posix::stream_descriptor::wait_read,
                   [self = shared_from_this()](const boost::system::error_code& failed) {
                     if (!failed) self->reap();
                   });
  }

  void reap() {
    int status = 0;
    if (::waitpid(pid, &status, WNOHANG) != pid) return wait();
    is_running = false;
    const std::string text = exit_text(status);
    const bool is_news = text != *last_exit;
    const auto level = status == 0 ? spdlog::level::info : spdlog::level::warn;
    spdlog::log(is_news ? level : spdlog::level::debug, "{}: process {} {}", name, pid, text);
    *last_exit = text;
  }

  std::string name;
  pid_t pid;
  asio::posix::stream_descriptor end;
  std::shared_ptr<std::string> last_exit;
  bool is_running = true;
};

ChildProcess::ChildProcess(asio::io_context& main, std::string command,
                           std::vector<std::string> environment)
    : main_(main),
      command_(std::move(command)),
      environment_(std::move(environment)),
      last_exit_(std::make_shared<std::string>()) {}

Result<UniqueFd> ChildProcess::open() {
  if (child_ && child_->is_running) return UniqueFd();
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return system_error("make a pipe for " + name(), errno);
  const UniqueFd reading(ends[0]);
  UniqueFd writing(ends[1]);
  pid_t pid = 0;
  if (int failed = spawn(command_, merged_environment(environment_), reading.get(), &pid)) {
    return system_error("start " + name(), failed);
  }
  // Debian 12's <sys/pidfd.h> declares pidfd_open() for C only.
  UniqueFd pidfd(static_cast<int>(::syscall(SYS_pidfd_open, pid, 0)));
  if (!pidfd) {
    auto error = system_error("watch " + name(), errno);
    ::kill(pid, SIGKILL);  // unwatched it would stay a zombie; after this the wait is short
    ::waitpid(pid, nullptr, 0);
    return error;
  }
  child_ = std::make_shared<Child>(main_, name(), pid, pidfd.release(), last_exit_);
  child_->wait();
  return writing;
}

std::string ChildProcess::name() const { return "command \"" + command_ + "\""; }

}  // namespace orbbuf
