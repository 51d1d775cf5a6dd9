// SPDX-License-Identifier: Apache-2.0
#include "common/progress.hpp"

#include <fmt/core.h>
#include <unistd.h>

#include <cstdio>
#include <utility>

namespace orbbuf {
namespace {

constexpr std::chrono::milliseconds kOnTerminal{200};
constexpr std::chrono::seconds kElsewhere{5};

}  // namespace

Progress::Progress(std::string what, std::string unit, std::size_t total,
                   std::function<Clock::time_point()> now)
    : what_(std::move(what)),
      unit_(std::move(unit)),
      total_(total),
      now_(std::move(now)),
      is_terminal_(::isatty(STDERR_FILENO) == 1),
      begin_(now_()),
      said_(begin_) {}

Progress::~Progress() {
  if (!is_terminal_ || said_ == begin_) return;
  say(now_());
  std::fputc('\n', stderr);
}

void Progress::add(std::size_t count) {
  const std::lock_guard lock(mutex_);
  done_ += count;
  const auto now = now_();
  if (is_terminal_ ? now - said_ < kOnTerminal : now - said_ < kElsewhere) return;
  say(now);
}

void Progress::say(Clock::time_point now) {
  said_ = now;
  const double elapsed_s = std::chrono::duration<double>(now - begin_).count();
  const double rate = elapsed_s > 0 ? static_cast<double>(done_) / elapsed_s : 0;
  const double left_s = rate > 0 ? static_cast<double>(total_ - done_) / rate : 0;
  fmt::print(stderr, "{}{}: {} of {} {}, {:.1f} a second, {:.0f} s remain{}",
             is_terminal_ ? "\r" : "", what_, done_, total_, unit_, rate, left_s,
             is_terminal_ ? "   " : "\n");
  std::fflush(stderr);
}

}  // namespace orbbuf
