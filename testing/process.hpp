// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <chrono>
#include <condition_variable>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

namespace orbbuf::test {

/// A real child process whose standard output and error are read line by line as they come.
class Process {
 public:
  /// command[0] is looked up in $PATH. Throws std::runtime_error if it cannot be started.
  explicit Process(const std::vector<std::string>& command);
  /// Kills the process if it still runs.
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  pid_t pid() const { return pid_; }
  void signal(int number) const;

  /// Waits for a line that contains `text`, from the first line on; the line itself, or nothing if
  /// the process ends or `limit` passes without one.
  std::optional<std::string> wait_for_line(const std::string& text,
                                           std::chrono::seconds limit = std::chrono::seconds(60));

  /// The same; throws std::runtime_error, with all that was written, if there is none.
  std::string require_line(const std::string& text,
                           std::chrono::seconds limit = std::chrono::seconds(60));

  /// Waits until `wanted` lines contain `text`. False if the process ends or `limit` passes first.
  bool wait_for_lines(const std::string& text, int wanted,
                      std::chrono::seconds limit = std::chrono::seconds(60));

  /// Waits for the end: the exit status, 128 + the signal's number, or -1 if `limit` passes.
  int wait(std::chrono::seconds limit = std::chrono::seconds(120));

  /// All that was written so far.
  std::string output() const;
  /// How many lines contain `text`.
  int count_lines(const std::string& text) const;

 private:
  void read_lines(int pipe);
  int count(const std::string& text) const;  // requires mutex_

  pid_t pid_ = -1;
  std::optional<int> status_;  // test's thread only
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::string> lines_;  // guarded by mutex_
  bool is_at_end_ = false;          // guarded by mutex_
  std::jthread reader_;
};

/// `command`, and `--set` before each of `settings`.
std::vector<std::string> with_settings(std::vector<std::string> command,
                                       const std::vector<std::string>& settings);

/// What stands in `line` behind `before`, up to a blank, a comma or a slash.
std::string word_after(const std::string& line, const std::string& before);

/// Runs a command to its end, or for `limit`: exit status, as Process::wait() has it, and output.
struct Finished {
  int status = -1;
  std::string output;
};
Finished run(const std::vector<std::string>& command,
             std::chrono::seconds limit = std::chrono::seconds(120));

}  // namespace orbbuf::test
