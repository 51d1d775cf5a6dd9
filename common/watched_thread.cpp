// SPDX-License-Identifier: Apache-2.0
#include "common/watched_thread.hpp"

#include <algorithm>
#include <functional>

#include "common/log.hpp"

namespace orbbuf {
namespace {

std::mutex mutex;

thread_local WatchedThread* this_thread = nullptr;

}  // namespace

/// Guarded by `mutex`.
std::list<WatchedThread::Entry>& WatchedThread::threads() {
  static std::list<Entry> threads;
  return threads;
}

WatchedThread::WatchedThread(const char* name) {
  {
    const std::lock_guard lock(mutex);
    entry_ = threads().insert(threads().end(), {name, Clock::now()});
    this_thread = this;
  }
  name_this_thread(name);  // last: a thread that has its name is watched
}

WatchedThread::~WatchedThread() {
  const std::lock_guard lock(mutex);
  threads().erase(entry_);
  this_thread = nullptr;
}

std::vector<WatchedThread::Still> WatchedThread::find_still(std::chrono::nanoseconds limit) {
  std::vector<Still> still;
  const std::lock_guard lock(mutex);
  const auto now = Clock::now();
  for (const Entry& entry : threads()) {
    const auto time = now - entry.last_beat;
    if (time > limit) still.push_back({entry.name, time});
  }
  std::ranges::sort(still, std::greater(), &Still::time);
  return still;
}

void beat() {
  if (this_thread == nullptr) return;
  const std::lock_guard lock(mutex);
  this_thread->entry_->last_beat = WatchedThread::Clock::now();
}

}  // namespace orbbuf
