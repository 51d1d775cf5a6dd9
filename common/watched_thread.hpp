// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <list>
#include <mutex>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

namespace orbbuf {

/// How often a watched thread beats while it waits.
inline constexpr std::chrono::seconds kBeatInterval{1};

/// As long as it lives the thread that made it is watched: it beats each time it gets round, also
/// while it waits, and who looks finds the one that has not. The threads are in one list for the
/// whole process, so that what waits deep inside a source needs no one handed down to it.
class WatchedThread {
 public:
  using Clock = std::chrono::steady_clock;

  /// Names the calling thread as name_this_thread() does. One a thread; ends on the same thread.
  explicit WatchedThread(const char* name);
  ~WatchedThread();
  WatchedThread(const WatchedThread&) = delete;
  WatchedThread& operator=(const WatchedThread&) = delete;

  struct Still {
    std::string name;
    std::chrono::nanoseconds time;  ///< since it last beat
  };
  /// Any thread: those that have not beaten for longer than `limit`, the longest first. One that
  /// stands still with a lock stops others that want it, so the first need not be the cause.
  static std::vector<Still> find_still(std::chrono::nanoseconds limit);

 private:
  friend void beat();
  struct Entry {
    std::string name;
    Clock::time_point last_beat;
  };
  static std::list<Entry>& threads();

  std::list<Entry>::iterator entry_;
};

/// The calling thread gets round. Does nothing for one that is not watched.
void beat();

/// condition.wait(lock, ready), beating.
template <class Lock, class Ready>
void wait_beating(std::condition_variable_any& condition, Lock& lock, Ready ready) {
  do beat();
  while (!condition.wait_for(lock, kBeatInterval, ready));
}

/// condition.wait(lock, stop, ready), beating: ready(), which is false only if `stop` came first.
template <class Lock, class Ready>
bool wait_beating(std::condition_variable_any& condition, Lock& lock, const std::stop_token& stop,
                  Ready ready) {
  for (;;) {
    beat();
    if (condition.wait_for(lock, stop, kBeatInterval, ready)) return true;
    if (stop.stop_requested()) return false;
  }
}

}  // namespace orbbuf
