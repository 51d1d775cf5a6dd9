// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <mutex>
#include <string>

namespace orbbuf {

/// How far a long job is, on stderr: one line that is rewritten on a terminal, otherwise a plain
/// line every 5 s; each with the rate and the time that remains. A job that ends before the first
/// one is due is silent. Thread-safe.
class Progress {
 public:
  /// what: "export"; unit: "images", as they shall read in the line.
  Progress(std::string what, std::string unit, std::size_t total);
  /// Ends the line on a terminal.
  ~Progress();
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  /// `count` more are done.
  void add(std::size_t count = 1);

 private:
  using Clock = std::chrono::steady_clock;

  void say(Clock::time_point now);

  std::mutex mutex_;  // guards all that follows
  const std::string what_;
  const std::string unit_;
  const std::size_t total_;
  const bool is_terminal_;
  const Clock::time_point begin_;
  Clock::time_point said_;
  std::size_t done_ = 0;
};

}  // namespace orbbuf
