// SPDX-License-Identifier: Apache-2.0
#include "common/non_blocking_sink.hpp"

#include <fmt/core.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <climits>
#include <cstddef>

namespace orbbuf {
namespace {

bool is_socket(int fd) {
  struct stat status {};
  return ::fstat(fd, &status) == 0 && S_ISSOCK(status.st_mode);
}

bool is_ready(int fd) {
  pollfd entry{fd, POLLOUT, 0};
  return ::poll(&entry, 1, 0) == 1;
}

}  // namespace

NonBlockingSink::NonBlockingSink(int fd) : fd_(fd), is_socket_(is_socket(fd)) {}

void NonBlockingSink::sink_it_(const spdlog::details::log_msg& message) {
  bool is_written = rest_.empty() || write(std::string(rest_));
  if (is_written && lost_ > 0) {
    const auto text = fmt::format("{} lines of the log were lost: stderr did not take them", lost_);
    is_written = write_line({message.logger_name, spdlog::level::warn, text});
    if (is_written) lost_ = 0;
  }
  if (!is_written || !write_line(message)) ++lost_;
}

/// False if nothing of it was written.
bool NonBlockingSink::write_line(const spdlog::details::log_msg& message) {
  if (!rest_.empty()) return false;
  spdlog::memory_buf_t line;
  formatter_->format(message, line);
  return write({line.data(), line.size()});
}

/// Writes what `fd` takes now, and keeps the rest. False, and nothing kept, if it takes nothing.
bool NonBlockingSink::write(std::string_view text) {
  std::size_t done = 0;
  while (done < text.size() && is_ready(fd_)) {
    // A pipe that is ready takes this much.
    const auto piece = text.substr(done, PIPE_BUF);
    const ssize_t written =
        is_socket_ ? ::send(fd_, piece.data(), piece.size(), MSG_DONTWAIT | MSG_NOSIGNAL)
                   : ::write(fd_, piece.data(), piece.size());
    if (written <= 0) break;
    done += static_cast<std::size_t>(written);
  }
  if (done == 0) return false;
  rest_ = text.substr(done);
  return true;
}

}  // namespace orbbuf
