// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <list>
#include <stop_token>
#include <string>
#include <vector>

namespace orbbuf {

/// How often a watched thread calls beat() while it waits.
inline constexpr std::chrono::seconds kBeatInterval{1};

/// Registers the calling thread with the watchdog for the lifetime of this object. A watched thread
/// calls beat() in every iteration of its loop, also while it waits; find_still() lists the threads
/// that have not. The registry is one list per process, so code deep inside a source can call
/// beat() without a parameter.
class WatchedThread {
 public:
  using Clock = std::chrono::steady_clock;

  /// Names the calling thread as name_this_thread() does. One per thread; destroyed on that thread.
  explicit WatchedThread(const char* name);
  ~WatchedThread();
  WatchedThread(const WatchedThread&) = delete;
  WatchedThread& operator=(const WatchedThread&) = delete;

  struct Still {
    std::string name;
    std::chrono::nanoseconds time;  ///< since it last beat
  };
  /// The threads that have not called beat() for longer than `limit`, the longest first. A thread
  /// that hangs while it holds a lock stops the threads that need the lock, so the first one need
  /// not be the cause. Callable from any thread.
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

/// Marks the calling thread as alive. Does nothing for a thread that is not watched.
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
