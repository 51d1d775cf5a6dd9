// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/sinks/base_sink.h>

#include <cstdint>
#include <mutex>
#include <string>
#include <string_view>

namespace orbbuf {

/// Writes the log to a descriptor, and never waits for its reader: a line that the descriptor does
/// not take at once is lost. The next line that it takes follows one with the number of lines lost.
/// Every line arrives whole or not at all. Thread-safe.
class NonBlockingSink final : public spdlog::sinks::base_sink<std::mutex> {
 public:
  /// `fd` must outlive the sink. A pipe or a terminal that other processes write to as well must
  /// have O_NONBLOCK; otherwise they may fill it between the look at it and the write.
  explicit NonBlockingSink(int fd);

 private:
  void sink_it_(const spdlog::details::log_msg& message) override;
  void flush_() override {}

  bool write_line(const spdlog::details::log_msg& message);
  bool write(std::string_view text);

  const int fd_;
  const bool is_socket_;
  std::string rest_;  ///< of a line that was written in part
  std::uint64_t lost_ = 0;
};

}  // namespace orbbuf
