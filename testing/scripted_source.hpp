// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <stop_token>
#include <string>
#include <utility>

#include "daemon/capture/frame_source.hpp"

namespace orbbuf::test {

/// A source of the frames that a test adds, before the source is read or meanwhile. Thread-safe.
class ScriptedSource : public FrameSource {
 public:
  explicit ScriptedSource(bool is_live = false, std::string description = "scripted")
      : is_live_(is_live), description_(std::move(description)) {}

  void add(RawFrame frame) {
    const std::lock_guard lock(mutex_);
    frames_.push_back(std::move(frame));
    changed_.notify_all();
  }
  /// After the frames added, the source ends; with a text, it fails with that.
  void end(std::string failure = {}) {
    const std::lock_guard lock(mutex_);
    has_ended_ = true;
    failure_ = std::move(failure);
    changed_.notify_all();
  }

  std::optional<RawFrame> next(std::stop_token stop) override {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, stop, [this] { return !frames_.empty() || has_ended_; });
    if (stop.stop_requested()) return std::nullopt;
    if (frames_.empty() && !failure_.empty()) throw std::runtime_error(failure_);
    if (frames_.empty()) return std::nullopt;
    RawFrame frame = std::move(frames_.front());
    frames_.pop_front();
    const int index = index_++;
    lock.unlock();
    if (before_frame) before_frame(index);
    return frame;
  }
  bool is_live() const override { return is_live_; }
  std::string description() const override { return description_; }

  /// Called by next() before it returns the frame of that index; set before the source is read.
  std::function<void(int index)> before_frame;

 private:
  const bool is_live_;
  const std::string description_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  std::deque<RawFrame> frames_;
  bool has_ended_ = false;
  std::string failure_;
  int index_ = 0;
};

}  // namespace orbbuf::test
