// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <cstddef>
#include <deque>
#include <mutex>
#include <optional>
#include <stop_token>
#include <utility>

#include "common/watched_thread.hpp"

namespace orbbuf {

/// A queue of a few slots between `capture` and `worker` that keeps the newest items: when it is
/// full, put() removes the oldest item and returns it. It has several slots so that a burst loses
/// nothing. Thread-safe: one writer, one reader.
template <class T>
class Mailbox {
 public:
  /// slots: at least 1.
  explicit Mailbox(std::size_t slots) : slots_(slots) {}

  /// Never waits. Returns the oldest item if there was no slot left for `item`.
  std::optional<T> put(T item) {
    const std::lock_guard lock(mutex_);
    std::optional<T> overwritten;
    if (items_.size() == slots_) overwritten = pop();
    items_.push_back(std::move(item));
    changed_.notify_all();
    return overwritten;
  }

  /// Waits until all slots are empty, for a writer that can wait. False if `stop` came first.
  bool wait_until_empty(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    return wait_beating(changed_, lock, stop, [this] { return items_.empty(); });
  }

  /// Waits for an item. Nothing once the mailbox is closed and empty.
  std::optional<T> take() {
    std::unique_lock lock(mutex_);
    wait_beating(changed_, lock, [this] { return !items_.empty() || is_closed_; });
    std::optional<T> item = pop();
    changed_.notify_all();
    return item;
  }

  /// Whether take() would wait now, for a reader that has other work to do.
  bool take_would_wait() const {
    const std::lock_guard lock(mutex_);
    return items_.empty() && !is_closed_;
  }

  /// The writer is done. The items in the mailbox can still be taken.
  void close() {
    const std::lock_guard lock(mutex_);
    is_closed_ = true;
    changed_.notify_all();
  }

 private:
  std::optional<T> pop() {
    if (items_.empty()) return std::nullopt;
    std::optional<T> item(std::move(items_.front()));
    items_.pop_front();
    return item;
  }

  const std::size_t slots_;
  mutable std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<T> items_;     // guarded by mutex_, at most slots_
  bool is_closed_ = false;  // guarded by mutex_
};

}  // namespace orbbuf
