// SPDX-License-Identifier: Apache-2.0
#include "testing/process.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <stdexcept>

namespace orbbuf::test {

Process::Process(const std::vector<std::string>& command) {
  std::array<int, 2> pipe{};
  if (::pipe2(pipe.data(), O_CLOEXEC) != 0) throw std::runtime_error("pipe2 failed");
  posix_spawn_file_actions_t actions;
  ::posix_spawn_file_actions_init(&actions);
  ::posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  ::posix_spawn_file_actions_adddup2(&actions, pipe[1], STDOUT_FILENO);
  ::posix_spawn_file_actions_adddup2(&actions, pipe[1], STDERR_FILENO);
  std::vector<char*> arguments;
  arguments.reserve(command.size() + 1);
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  const int error =
      ::posix_spawnp(&pid_, arguments[0], &actions, nullptr, arguments.data(), environ);
  ::posix_spawn_file_actions_destroy(&actions);
  ::close(pipe[1]);
  if (error != 0) {
    ::close(pipe[0]);
    throw std::runtime_error("cannot start " + command[0] + ": " + std::strerror(error));
  }
  reader_ = std::jthread([this, end = pipe[0]] { read_lines(end); });
}

Process::~Process() {
  if (!status_) {
    signal(SIGKILL);
    wait();
  }
}

void Process::signal(int number) const {
  if (!status_) ::kill(pid_, number);
}

void Process::read_lines(int pipe) {
  std::FILE* const stream = ::fdopen(pipe, "r");
  char* line = nullptr;
  std::size_t size = 0;
  while (::getline(&line, &size, stream) >= 0) {
    const std::lock_guard lock(mutex_);
    lines_.emplace_back(line);
    if (lines_.back().ends_with('\n')) lines_.back().pop_back();
    changed_.notify_all();
  }
  std::free(line);
  std::fclose(stream);
  const std::lock_guard lock(mutex_);
  is_at_end_ = true;
  changed_.notify_all();
}

std::optional<std::string> Process::wait_for_line(const std::string& text,
                                                  std::chrono::seconds limit) {
  std::unique_lock lock(mutex_);
  std::size_t seen = 0;
  std::optional<std::string> found;
  changed_.wait_for(lock, limit, [&] {
    for (; seen < lines_.size() && !found; ++seen) {
      if (lines_[seen].find(text) != std::string::npos) found = lines_[seen];
    }
    return found || is_at_end_;
  });
  return found;
}

std::string Process::require_line(const std::string& text, std::chrono::seconds limit) {
  if (const auto line = wait_for_line(text, limit)) return *line;
  throw std::runtime_error("no \"" + text + "\" in: " + output());
}

int Process::wait(std::chrono::seconds limit) {
  if (status_) return *status_;
  {
    std::unique_lock lock(mutex_);
    if (!changed_.wait_for(lock, limit, [this] { return is_at_end_; })) return -1;
  }
  int status = 0;
  while (::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
  }
  status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return *status_;
}

std::string Process::output() const {
  const std::lock_guard lock(mutex_);
  std::string all;
  for (const std::string& line : lines_) all += line + '\n';
  return all;
}

int Process::count_lines(const std::string& text) const {
  const std::lock_guard lock(mutex_);
  return count(text);
}

bool Process::wait_for_lines(const std::string& text, int wanted, std::chrono::seconds limit) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, limit, [&] { return count(text) >= wanted || is_at_end_; });
  return count(text) >= wanted;
}

int Process::count(const std::string& text) const {
  return static_cast<int>(std::ranges::count_if(
      lines_, [&](const std::string& line) { return line.find(text) != std::string::npos; }));
}

std::vector<std::string> with_settings(std::vector<std::string> command,
                                       const std::vector<std::string>& settings) {
  for (const std::string& setting : settings) command.insert(command.end(), {"--set", setting});
  return command;
}

std::string word_after(const std::string& line, const std::string& before) {
  const std::size_t begin = line.find(before) + before.size();
  return line.substr(begin, line.find_first_of(" ,/", begin) - begin);
}

Finished run(const std::vector<std::string>& command, std::chrono::seconds limit) {
  Process process(command);
  Finished finished;
  finished.status = process.wait(limit);
  finished.output = process.output();
  return finished;
}

}  // namespace orbbuf::test
