// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe/child_output.hpp"

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <utility>

#include "common/log.hpp"
#include "server/runtime/adopt.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;

constexpr std::chrono::milliseconds kPause{5};
constexpr std::size_t kMostLeftBytes = 65'536;  // what a pipe holds

}  // namespace

void OutputLog::add(std::string_view text, Moment now) {
  while (!text.empty()) {
    const std::size_t end = std::min(text.find_first_of("\r\n"), text.size());
    const std::size_t room = kLineBytes - line_.size();
    line_.append(text.substr(0, std::min(end, room)));
    is_cut_ = is_cut_ || end > room;
    if (end == text.size()) return;
    log_line(now);
    text.remove_prefix(end + 1);
  }
}

void OutputLog::end(Moment now) {
  log_line(now);
  if (left_out_ > 0) log_left_out();
}

void OutputLog::log_line(Moment now) {
  const std::string line = std::exchange(line_, {});
  const bool is_cut = std::exchange(is_cut_, false);
  if (line.empty()) return;
  if (!lets_through(now)) {
    ++left_out_;
    return;
  }
  if (left_out_ > 0) log_left_out();
  log_info("{}: {}{}", label_, printable(line), is_cut ? "..." : "");
}

bool OutputLog::lets_through(Moment now) {
  if (counted_until_ != Moment::min()) {
    const std::chrono::duration<double> passed = now - counted_until_;
    allowed_ = std::min<double>(kBurst, allowed_ + passed.count() * kPerSecond);
  }
  counted_until_ = now;
  if (allowed_ < 1) return false;
  --allowed_;
  return true;
}

ChildOutput::ChildOutput(asio::io_context& main, std::shared_ptr<OutputLog> log)
    : pipe_(main), pause_(main), log_(std::move(log)) {}

std::optional<Error> ChildOutput::start(UniqueFd end) {
  if (auto error = adopt(pipe_, std::move(end), "the output of a command")) return error;
  error_code failed;
  pipe_.non_blocking(true, failed);
  if (failed) {
    close();
  } else {
    wait();
  }
  return std::nullopt;
}

void ChildOutput::wait() {
  pipe_.async_wait(asio::posix::stream_descriptor::wait_read,
                   [self = shared_from_this()](const error_code& failed) {
                     if (!failed && self->pipe_.is_open()) self->take();
                   });
}

void ChildOutput::take() {
  const std::size_t bytes = take_block();
  if (!pipe_.is_open()) return;
  bytes < block_.size() ? wait() : pause();
}

void ChildOutput::pause() {
  pause_.expires_after(kPause);
  pause_.async_wait([self = shared_from_this()](const error_code& failed) {
    if (!failed && self->pipe_.is_open()) self->wait();
  });
}

/// Closes the pipe at its end; else returns how much there was, zero if nothing yet.
std::size_t ChildOutput::take_block() {
  error_code failed;
  const std::size_t bytes = pipe_.read_some(asio::buffer(block_), failed);
  log_->add({block_.data(), bytes});
  if (failed && failed != asio::error::would_block) close();
  return bytes;
}

void ChildOutput::finish() {
  for (std::size_t taken = 0; pipe_.is_open() && taken < kMostLeftBytes;) {
    const std::size_t bytes = take_block();
    if (bytes == 0) break;
    taken += bytes;
  }
  if (pipe_.is_open()) close();
}

void ChildOutput::close() {
  error_code ignored;  // there is nothing to do about it
  pause_.cancel();
  pipe_.close(ignored);
  log_->end();
}

}  // namespace orbbuf
