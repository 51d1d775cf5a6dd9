// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe/child_process.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <cerrno>
#include <csignal>
#include <cstring>
#include <string_view>
#include <utility>

#include "common/log.hpp"
#include "common/quantity.hpp"
#include "server/runtime/adopt.hpp"
#include "server/sink/pipe/child_output.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using Clock = std::chrono::steady_clock;

/// How a waitpid() status reads in a log line.
std::string exit_text(int status) {
  if (WIFEXITED(status)) return fmt::format("exited with status {}", WEXITSTATUS(status));
  const int signal = WTERMSIG(status);
  return fmt::format("was killed by signal {} ({})", signal, ::strsignal(signal));
}

constexpr int kFirstDescriptorToClose = 3;

std::string_view variable(std::string_view entry) { return entry.substr(0, entry.find('=')); }

/// systemd means them for the server alone.
bool is_for_server_alone(std::string_view name) {
  constexpr std::array<std::string_view, 4> kNames = {"CREDENTIALS_DIRECTORY", "NOTIFY_SOCKET",
                                                      "WATCHDOG_PID", "WATCHDOG_USEC"};
  return std::ranges::find(kNames, name) != kNames.end();
}

/// `ours` first, and of the server's own what is not among it.
std::vector<std::string> merged_environment(const std::vector<std::string>& ours) {
  std::vector<std::string> merged = ours;
  for (char** entry = environ; *entry != nullptr; ++entry) {
    if (is_for_server_alone(variable(*entry))) continue;
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

int add_descriptors(posix_spawn_file_actions_t& actions, int input, int output) {
  int failed = posix_spawn_file_actions_adddup2(&actions, input, STDIN_FILENO);
  if (failed == 0) failed = posix_spawn_file_actions_adddup2(&actions, output, STDOUT_FILENO);
  if (failed == 0) failed = posix_spawn_file_actions_adddup2(&actions, output, STDERR_FILENO);
  if (failed != 0) return failed;
  return posix_spawn_file_actions_addclosefrom_np(&actions, kFirstDescriptorToClose);
}

/// Starts `sh -c command` with `input` as its standard input, `output` as its standard output and
/// error, and no other descriptor of ours; in a process group of its own, with SIGPIPE as usual,
/// and without a higher priority of ours. environment: `NAME=value`, laid over our own, of which it
/// gets neither systemd's credentials (the keys of TLS) nor its notification socket and watchdog.
/// Zero, or an errno value.
int spawn(const std::string& command, const std::vector<std::string>& environment, int input,
          int output, pid_t* pid) {
  posix_spawn_file_actions_t actions;
  posix_spawnattr_t attributes;
  sigset_t defaults;
  sigemptyset(&defaults);
  for (const int ignored : {SIGPIPE, SIGUSR1, SIGUSR2}) sigaddset(&defaults, ignored);
  if (int failed = posix_spawn_file_actions_init(&actions)) return failed;
  int failed = posix_spawnattr_init(&attributes);
  if (failed == 0) {
    posix_spawnattr_setsigdefault(&attributes, &defaults);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
    failed = add_descriptors(actions, input, output);
    std::vector<std::string> arguments{"sh", "-c", command};
    std::vector<std::string> variables = merged_environment(environment);
    if (failed == 0) {
      failed = ::posix_spawn(pid, "/bin/sh", &actions, &attributes, c_strings(arguments).data(),
                             c_strings(variables).data());
      if (failed == 0 && ::getpriority(PRIO_PROCESS, 0) < 0 &&
          ::setpriority(PRIO_PGRP, static_cast<id_t>(*pid), 0) != 0) {
        log_warn("slam: a command keeps the server's priority: {}", std::strerror(errno));
      }
    }
    posix_spawnattr_destroy(&attributes);
  }
  posix_spawn_file_actions_destroy(&actions);
  return failed;
}

struct Pipe {
  UniqueFd reading;
  UniqueFd writing;
};

Result<Pipe> make_pipe(const std::string& whose) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) return system_error("make a pipe for " + whose, errno);
  return Pipe{UniqueFd(ends[0]), UniqueFd(ends[1])};
}

}  // namespace

Backoff::Duration Backoff::after(Duration run) {
  constexpr Duration kFirst = std::chrono::seconds(2);
  if (run >= kLongRun) next_ = Duration(0);
  const Duration wait = next_;
  next_ = std::clamp(2 * wait, kFirst, kLongest);
  return wait;
}

/// What one child leaves to the next.
struct ChildProcess::History {
  History(std::string whose, Restart policy)
      : label(std::move(whose)),
        restart(policy),
        output(std::make_shared<OutputLog>(label + ": slam")) {}

  bool allows_start() const { return !is_over && Clock::now() >= next_start; }

  /// A child that ran since `started` has ended.
  void note_end(const std::string& name, pid_t pid, int status, Clock::time_point started) {
    const auto now = Clock::now();
    const auto wait = backoff.after(now - started);
    next_start = now + wait;
    is_over = restart == Restart::kNever || (restart == Restart::kOnFailure && status == 0);
    const std::string text = exit_text(status);
    const bool is_news = std::exchange(last_exit, text) != text;  // a crash loop is one warning
    const auto level = status == 0 ? LogLevel::kInfo : LogLevel::kWarn;
    std::string next;
    if (is_over) next = "; not started again";
    if (!is_over && wait > wait.zero()) next = "; next start in " + format_duration(wait);
    log_at(is_news ? level : LogLevel::kDebug, "{}: {}: process {} {}{}", label, name, pid, text,
           next);
  }

  const std::string label;
  const Restart restart;
  const std::shared_ptr<OutputLog> output;
  Backoff backoff;
  Clock::time_point next_start = Clock::time_point::min();
  bool is_over = false;
  std::string last_exit;
};

/// A running child; the wait for its end keeps it alive.
struct ChildProcess::Child : std::enable_shared_from_this<Child> {
  Child(asio::io_context& main, std::string child_name, pid_t child_pid)
      : name(std::move(child_name)), pid(child_pid), end(main), patience(main) {}

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
    patience.cancel();
    output->finish();
    history->note_end(name, pid, status, started);
    std::exchange(gone, nullptr)();
  }

  /// Its input has ended.
  void end_within(const Patience& limits) {
    const auto kill_later = [self = shared_from_this(), limits] {
      self->signal(SIGTERM, "the end of its input");
      self->after(limits.with_term, [self] { self->signal(SIGKILL, "SIGTERM"); });
    };
    after(limits.with_end, kill_later);
  }

  void after(std::chrono::milliseconds wait, std::function<void()> act) {
    patience.expires_after(wait);
    patience.async_wait(
        [self = shared_from_this(), act = std::move(act)](const boost::system::error_code& failed) {
          if (!failed && self->is_running) act();
        });
  }

  void signal(int number, const char* ignored) const {
    log_warn("{}: {}: process {} ignores {}; sending SIG{}", history->label, name, pid, ignored,
             ::sigabbrev_np(number));
    ::kill(-pid, number);
  }

  const std::string name;
  const pid_t pid;
  asio::posix::stream_descriptor end;
  asio::steady_timer patience;
  const Clock::time_point started = Clock::now();
  std::shared_ptr<ChildOutput> output;
  std::shared_ptr<History> history;
  std::function<void()> gone;
  bool is_running = true;
};

ChildProcess::ChildProcess(asio::io_context& main, std::string label, std::string command,
                           std::vector<std::string> environment, Restart restart)
    : ChildProcess(main, std::move(label), std::move(command), std::move(environment), restart,
                   Patience()) {}

ChildProcess::ChildProcess(asio::io_context& main, std::string label, std::string command,
                           std::vector<std::string> environment, Restart restart, Patience patience)
    : main_(main),
      command_(std::move(command)),
      environment_(std::move(environment)),
      history_(std::make_shared<History>(std::move(label), restart)),
      patience_(patience) {}

ChildProcess::~ChildProcess() {
  if (child_ && child_->is_running) child_->end_within(patience_);
}

Result<UniqueFd> ChildProcess::connect(std::function<void()> gone) {
  if ((child_ && child_->is_running) || !history_->allows_start()) return UniqueFd();
  auto input = make_pipe(name());
  if (!input) return std::move(input).error();
  auto output = make_pipe(name());
  if (!output) return std::move(output).error();
  pid_t pid = 0;
  if (int failed = spawn(command_, environment_, input.value().reading.get(),
                         output.value().writing.get(), &pid)) {
    return system_error("start " + name(), failed);
  }
  if (auto error = watch(pid, std::move(output.value().reading), std::move(gone))) {
    child_.reset();
    ::kill(-pid, SIGKILL);  // unwatched it would stay a zombie; after this the wait is short
    ::waitpid(pid, nullptr, 0);
    return std::move(*error);
  }
  return std::move(input.value().writing);
}

std::optional<Error> ChildProcess::watch(pid_t pid, UniqueFd output, std::function<void()> gone) {
  // Debian 12's <sys/pidfd.h> declares pidfd_open() for C only.
  UniqueFd pidfd(static_cast<int>(::syscall(SYS_pidfd_open, pid, 0)));
  if (!pidfd) return system_error("watch " + name(), errno);
  child_ = std::make_shared<Child>(main_, name(), pid);
  if (auto error = adopt(child_->end, std::move(pidfd), name())) return error;
  child_->history = history_;
  child_->gone = std::move(gone);
  child_->output = std::make_shared<ChildOutput>(main_, history_->output);
  if (auto error = child_->output->start(std::move(output))) return error;
  child_->wait();
  return std::nullopt;
}

}  // namespace orbbuf
