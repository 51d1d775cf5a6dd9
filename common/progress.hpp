// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <functional>
#include <mutex>
#include <string>

namespace orbbuf {

/// Prints the progress of a long job to stderr, with the rate and the remaining time: one line that
/// is rewritten on a terminal, else a new line every 5 s. Prints nothing for a job that ends before
/// the first line is due. Thread-safe.
class Progress {
 public:
  using Clock = std::chrono::steady_clock;

  /// The words of the line, for example what: "export", unit: "images". `now`: the time; reentrant.
  Progress(std::string what, std::string unit, std::size_t total,
           std::function<Clock::time_point()> now = Clock::now);
  /// Ends the line on a terminal.
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// `count` more are done.
  void add(std::size_t count = 1);

 private:
  void say(Clock::time_point now);

  std::mutex mutex_;  // guards all that follows
  const std::string what_;
  const std::string unit_;
  const std::size_t total_;
  const std::function<Clock::time_point()> now_;
  const bool is_terminal_;
  const Clock::time_point begin_;
  Clock::time_point said_;
  std::size_t done_ = 0;
};

}  // namespace orbbuf
