// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <mutex>
#include <optional>
#include <stop_token>
#include <utility>

namespace orbbuf {

/// One slot between `capture` and `worker`, latest wins: a reader that is late gets the newest
/// item, and the writer learns which one it overwrote. Thread-safe: one writer, one reader.
template <class T>
class Mailbox {
 public:
  /// Never waits. Returns the item that was still in the slot, if any.
  std::optional<T> put(T item) {
    const std::lock_guard lock(mutex_);
    std::optional<T> overwritten = std::exchange(slot_, std::move(item));
    changed_.notify_all();
    return overwritten;
  }

  /// Waits until the slot is empty, for a writer that can afford to. False if `stop` came first.
  bool wait_until_empty(std::stop_token stop) {
    std::unique_lock lock(mutex_);
    return changed_.wait(lock, std::move(stop), [this] { return !slot_; });
  }

  /// Waits for an item. Nothing once the mailbox is closed and empty.
  std::optional<T> take() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return slot_ || is_closed_; });
    std::optional<T> item = std::exchange(slot_, std::nullopt);
    changed_.notify_all();
    return item;
  }

  /// For a reader that has other things to do meanwhile: nothing is there to take, and the writer
  /// is not done.
  bool take_would_wait() const {
    const std::lock_guard lock(mutex_);
    return !slot_ && !is_closed_;
  }

  /// The writer is done: what is in the slot can still be taken.
  void close() {
    const std::lock_guard lock(mutex_);
    is_closed_ = true;
    changed_.notify_all();
  }

 private:
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::optional<T> slot_;   // guarded by mutex_
  bool is_closed_ = false;  // guarded by mutex_
};

}  // namespace orbbuf
