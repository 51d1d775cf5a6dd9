// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <mutex>
#include <string>
#include <string_view>
#include <utility>

#include "common/log.hpp"

namespace orbbuf {

/// The frames of a session that a sink answered as taken and gave up: counted, and logged with the
/// first one, then at most every 10 s, and with the last one. Thread-safe.
class Losses {
 public:
  /// name: of the session and the sink, for the log.
  explicit Losses(std::string name) : name_(std::move(name)) {}
  ~Losses() {
    if (count_ > logged_) log("the session is over");
  }
  Losses(const Losses&) = delete;
  Losses& operator=(const Losses&) = delete;

  void add(std::string_view reason) {
    const std::scoped_lock lock(mutex_);
    ++count_;
    if (limit_.lets_through()) log(reason);
  }
  std::uint64_t count() const {
    const std::scoped_lock lock(mutex_);
    return count_;
  }

 private:
  void log(std::string_view reason) {
    log_warn("{}: {} frames of this session not published: {}", name_, count_, reason);
    logged_ = count_;
  }

  const std::string name_;
  mutable std::mutex mutex_;
  std::uint64_t count_ = 0;                   // guarded by mutex_
  std::uint64_t logged_ = 0;                  // guarded by mutex_
  LogLimit limit_{std::chrono::seconds{10}};  // guarded by mutex_
};

}  // namespace orbbuf
