// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <csignal>
#include <optional>

#include "server/sink/frame_sink.hpp"

namespace orbbuf::test {

/// The two threads of the server: `main`, which is the test's and runs while the test waits for
/// something, and `files`.
class EventLoop : public testing::Test {
 protected:
  EventLoop() { std::signal(SIGPIPE, SIG_IGN); }

  /// Runs `main` until `is_so()`; false if that takes longer than any healthy machine would.
  template <class Condition>
  bool run_until(Condition is_so) {
    const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(200);
    while (!is_so()) {
      if (std::chrono::steady_clock::now() > deadline) return false;
      main_.run_one_for(std::chrono::milliseconds(20));
    }
    return true;
  }

  /// Runs what is ready.
  void run_ready() {
    while (main_.poll() > 0) {
    }
  }

  /// For a test's destructor: what the two threads hand each other holds strands, which must not
  /// outlive their pool.
  void end_work() {
    files_.join();
    run_ready();
  }

  /// Writes and waits for the sink's answer.
  std::optional<Error> write(FrameSink& sink, FramePtr frame) {
    std::optional<std::optional<Error>> answer;
    sink.async_write(std::move(frame), [&](const std::optional<Error>& error) { answer = error; });
    EXPECT_TRUE(run_until([&] { return answer.has_value(); }));
    return answer ? *answer : Error{"no answer"};
  }

  std::optional<Error> write(FrameSink& sink, ItemsPtr items) {
    std::optional<std::optional<Error>> answer;
    sink.async_write_items(std::move(items),
                           [&](const std::optional<Error>& error) { answer = error; });
    EXPECT_TRUE(run_until([&] { return answer.has_value(); }));
    return answer ? *answer : Error{"no answer"};
  }

  /// All children have ended and have been reaped.
  static bool has_no_children() {
    return ::waitid(P_ALL, 0, nullptr, WEXITED | WNOHANG | WNOWAIT) != 0 && errno == ECHILD;
  }

  boost::asio::io_context main_{1};
  boost::asio::thread_pool files_{1};

 private:
  boost::asio::executor_work_guard<boost::asio::io_context::executor_type> work_{
      main_.get_executor()};
};

}  // namespace orbbuf::test
