// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/posix/stream_descriptor.hpp>
#include <boost/asio/steady_timer.hpp>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "common/error.hpp"
#include "common/unique_fd.hpp"

namespace orbbuf {

/// Text of another program, line by line in the log, each after `label`. A line ends with '\n' or
/// '\r'; the rest of one that is longer than kLineBytes is left out. So are lines beyond kBurst at
/// once and kPerSecond from then on; how many is told by the next line that is not. Thread-bound.
class OutputLog {
 public:
  using Moment = std::chrono::steady_clock::time_point;
  static constexpr std::size_t kLineBytes = 500;
  static constexpr int kBurst = 100;
  static constexpr int kPerSecond = 10;

  explicit OutputLog(std::string label) : label_(std::move(label)) {}

  void add(std::string_view text, Moment now = std::chrono::steady_clock::now());
  /// The text has ended: what there is of a last line, and how many were left out.
  void end(Moment now = std::chrono::steady_clock::now());

 private:
  void log_line(Moment now);
  void log_left_out() { log_info("{}: ({} lines left out)", label_, std::exchange(left_out_, 0)); }
  bool lets_through(Moment now);

  const std::string label_;
  std::string line_;
  bool is_cut_ = false;
  double allowed_ = kBurst;  // lines
  Moment counted_until_ = Moment::min();
  std::uint64_t left_out_ = 0;
};

/// Reads what a child writes to its standard output and error, for as long as it does: at most
/// 16 KiB every 5 ms, so that a chatty child slows down only itself.
///
/// Thread-bound to `main`. Lives in a shared_ptr, which its outstanding operations hold.
class ChildOutput : public std::enable_shared_from_this<ChildOutput> {
 public:
  /// `main` must outlive the object.
  ChildOutput(boost::asio::io_context& main, std::shared_ptr<OutputLog> log);

  /// Reads `end`, the reading end of the child's output, from now on. Once.
  std::optional<Error> start(UniqueFd end);
  /// The child is gone: takes what it left in the pipe, and no more, also if another process still
  /// holds the other end.
  void finish();

 private:
  void wait();
  void take();
  void pause();
  std::size_t take_block();
  void close();

  boost::asio::posix::stream_descriptor pipe_;
  boost::asio::steady_timer pause_;
  const std::shared_ptr<OutputLog> log_;
  std::array<char, 16'384> block_{};
};

}  // namespace orbbuf
