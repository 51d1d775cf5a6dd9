// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe_sink.hpp"

#include <spdlog/spdlog.h>

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>
#include <cassert>
#include <chrono>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;

constexpr std::chrono::seconds kRetry{1};

}  // namespace

PipeSink::PipeSink(asio::io_context& main, asio::thread_pool& pool, std::string label,
                   std::unique_ptr<PipeReader> reader, PipeFormat format,
                   WithoutReader without_reader)
    : main_(main),
      pool_(pool),
      label_(std::move(label)),
      reader_(std::move(reader)),
      format_(format),
      without_reader_(without_reader),
      pipe_(main),
      retry_(main) {}

void PipeSink::start() { look_for_reader(); }

void PipeSink::async_write(FramePtr frame, Done done) {
  assert(!done_);
  frame_ = std::move(frame);
  done_ = std::move(done);
  is_cancelled_ = false;
  write_block();
}

void PipeSink::async_write_drops(std::vector<DropRecord> /*records*/, Done done) {
  asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
}

void PipeSink::cancel() {
  is_cancelled_ = true;
  if (is_waiting_) write_block();
}

void PipeSink::close() {
  is_closed_ = true;
  retry_.cancel();
  error_code ignored;  // nothing to do about it, and the reader has the end
  pipe_.close(ignored);
  if (is_waiting_) write_block();
}

/// Asks once, and again in a second if there is none.
void PipeSink::look_for_reader() {
  auto end = reader_->open();
  if (!end) {
    log_state(spdlog::level::err, end.error().text);
  } else if (!end.value()) {
    log_state(spdlog::level::info, "waits for a reader");
  } else {
    log_state(spdlog::level::info, "has a reader");
    frames_read_ = 0;
    pipe_.assign(end.value().release());
    watch_reader();
  }
  if (!pipe_.is_open()) return look_again_later();
  if (is_waiting_) write_block();
}

void PipeSink::look_again_later() {
  retry_.expires_after(kRetry);
  retry_.async_wait([self = shared_from_this()](const error_code& failed) {
    if (!failed && !self->is_closed_) self->look_for_reader();
  });
}

/// A pipe whose reader has gone reports an error condition at once, not only at the next write.
void PipeSink::watch_reader() {
  pipe_.async_wait(asio::posix::stream_descriptor::wait_error,
                   [self = shared_from_this()](const error_code& failed) {
                     if (!failed) self->reader_left();
                   });
}

void PipeSink::reader_left() {
  if (is_closed_ || !pipe_.is_open()) return;
  error_code ignored;  // a pipe without a reader has nothing left to lose
  pipe_.close(ignored);
  if (frames_read_ > 0) {  // a program that does not even start is told of by its exit status
    log_state(spdlog::level::info, fmt::format("lost its reader after {} frames", frames_read_));
  }
  look_again_later();
}

void PipeSink::log_state(spdlog::level::level_enum level, std::string state) {
  if (state == last_state_) return;
  spdlog::log(level, "{}: {}: {}", label_, reader_->name(), state);
  last_state_ = std::move(state);
}

/// Takes the call in progress as far as it can go now; called again whenever that may have changed.
void PipeSink::write_block() {
  is_waiting_ = false;
  if (is_closed_) return finish(Error{"write to " + reader_->name() + ": closed"});
  if (!pipe_.is_open()) {
    if (without_reader_ == WithoutReader::kPass) return finish(std::nullopt);
    if (is_cancelled_) return finish(Error{"write to " + reader_->name() + ": nobody reads"});
    is_waiting_ = true;
    return;
  }
  if (format_ == PipeFormat::kPgm && pgm_.empty()) return decode();
  const auto& block = format_ == PipeFormat::kPgm ? pgm_ : frame_->jpeg;
  asio::async_write(pipe_, asio::buffer(block),
                    [self = shared_from_this()](const error_code& failed, std::size_t) {
                      if (failed) {
                        self->reader_left();
                        return self->write_block();
                      }
                      ++self->frames_read_;
                      self->finish(std::nullopt);
                    });
}

void PipeSink::decode() {
  asio::post(pool_, [self = shared_from_this(), guard = asio::make_work_guard(main_)]() mutable {
    auto pgm = to_pgm(*self->frame_, self->codec_);
    // The sink must not end on this thread: `self` goes back to `main`.
    asio::post(guard.get_executor(), [self = std::move(self), pgm = std::move(pgm)]() mutable {
      self->decoded(std::move(pgm));
    });
  });
}

void PipeSink::decoded(Result<std::vector<std::uint8_t>> pgm) {
  if (!pgm) {
    spdlog::warn("{}: {}: skipped frame {}: {}", label_, reader_->name(), frame_->sequence,
                 pgm.error().text);
    return finish(std::nullopt);
  }
  pgm_ = std::move(pgm).value();
  write_block();
}

/// Answers the call, in a handler of its own: the caller may be within it.
void PipeSink::finish(std::optional<Error> error) {
  frame_.reset();
  pgm_.clear();
  asio::post(main_,
             [done = std::exchange(done_, nullptr), error = std::move(error)] { done(error); });
}

Result<std::vector<std::uint8_t>> to_pgm(const EncodedFrame& frame, JpegCodec& codec) {
  std::vector<std::uint8_t> pgm;
  const auto add = [&](std::span<const std::uint8_t> jpeg,
                       std::string_view camera) -> std::optional<Error> {
    auto image = codec.decode_gray(jpeg, 1);
    if (!image) return std::move(image).error();
    const auto& [width_px, height_px, pixels] = image.value();
    const std::string head =
        fmt::format("P5\n# seq={}\n# t={}\n{}{} {}\n255\n", frame.sequence,
                    format_seconds(frame.capture_time_ns), camera, width_px, height_px);
    pgm.reserve(pgm.size() + head.size() + pixels.size());
    pgm.insert(pgm.end(), head.begin(), head.end());
    pgm.insert(pgm.end(), pixels.begin(), pixels.end());
    return std::nullopt;
  };
  auto error = add(frame.left(), frame.is_stereo() ? "# camera=left\n" : "");
  if (!error && frame.is_stereo()) error = add(frame.right(), "# camera=right\n");
  if (error) return *std::move(error);
  return pgm;
}

}  // namespace orbbuf
