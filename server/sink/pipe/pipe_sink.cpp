// SPDX-License-Identifier: Apache-2.0
#include "server/sink/pipe/pipe_sink.hpp"

#include <sys/ioctl.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <boost/asio/write.hpp>
#include <cassert>
#include <utility>

#include "server/runtime/adopt.hpp"
#include "server/runtime/run_in_pool.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;

}  // namespace

PipeSink::PipeSink(asio::io_context& main, asio::thread_pool& pool, const SessionInfo& info,
                   std::unique_ptr<PipeReader> reader, PipeFormat format,
                   WithoutReader without_reader, const KeptFrames& kept, WallClock now)
    : main_(main),
      pool_(pool),
      label_(info.robot_id + " " + info.session_id),
      session_id_(info.session_id),
      streams_(info.streams),
      reader_(std::move(reader)),
      format_(format),
      without_reader_(without_reader),
      now_(std::move(now)),
      codec_(label_ + ": " + reader_->name()),
      follower_(kept.folder),
      pipe_(main),
      retry_(main),
      place_(without_reader == WithoutReader::kCatchUp && kept.next_sequence > 0 ? Place::kBehind
                                                                                 : Place::kLive),
      next_(kept.next_sequence > 0 ? kept.next_sequence - 1 : 0) {}

void PipeSink::async_write(FramePtr frame, Done done) {
  assert(!call_);
  call_ = Call{std::move(frame), std::move(done)};
  go_on();
}

void PipeSink::async_write_items(ItemsPtr items, Done done) {
  add_samples(items->stream, items->payload, live_samples_);
  asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
}

void PipeSink::cancel() {
  if (call_) call_->is_cancelled = true;
  go_on();
}

void PipeSink::async_drain(const SessionClosing& /*closing*/, Done drained) {
  drained_ = [drained = std::move(drained)] { drained(std::nullopt); };
  go_on();
}

void PipeSink::close() {
  reader_state_ = ReaderState::kClosed;
  retry_.cancel();
  error_code ignored;  // nothing to do about it, and the reader has the end
  pipe_.close(ignored);
  go_on();
}

/// Asks once, and again in a second if there is none.
void PipeSink::look_for_reader() {
  auto end = reader_->connect([weak = weak_from_this()] {
    if (const auto self = weak.lock()) self->on_reader_left();
  });
  if (!end) {
    log_state(LogLevel::kError, end.error().text);
  } else if (!end.value()) {
    log_state(LogLevel::kInfo, "no reader");
  } else if (auto error = adopt(pipe_, std::move(end).value(), reader_->name())) {
    log_state(LogLevel::kError, error->text);
  } else {
    log_state(LogLevel::kInfo, "has a reader");
    frames_read_ = 0;
    reader_state_ = ReaderState::kPresent;
    watch_reader();
  }
  if (reader_state_ != ReaderState::kPresent) return look_again_later();
  go_on();
}

void PipeSink::look_again_later() {
  retry_.expires_after(kRetry);
  retry_.async_wait([self = shared_from_this()](const error_code& failed) {
    if (!failed && self->reader_state_ == ReaderState::kAwaited) self->look_for_reader();
  });
}

/// A pipe whose reader has gone reports an error condition at once, not only at the next write.
void PipeSink::watch_reader() {
  pipe_.async_wait(asio::posix::stream_descriptor::wait_error,
                   [self = shared_from_this()](const error_code& failed) {
                     if (!failed) self->on_reader_left();
                   });
}

void PipeSink::on_reader_left() {
  if (reader_state_ != ReaderState::kPresent) return;
  reader_state_ = ReaderState::kAwaited;
  int unread_bytes = 0;
  if (::ioctl(pipe_.native_handle(), FIONREAD, &unread_bytes) != 0) unread_bytes = 0;
  unread_bytes_ = static_cast<std::uint64_t>(unread_bytes);
  error_code ignored;  // a pipe without a reader has nothing left to lose
  pipe_.close(ignored);
  if (frames_read_ > 0) {  // a program that does not even start is told of by its exit status
    log_state(LogLevel::kInfo, fmt::format("lost its reader after {} frames", frames_read_));
  }
  look_again_later();
  go_on();
}

/// What the last reader left in the pipe is the next one's.
void PipeSink::rewind() {
  const std::uint64_t read_bytes = written_bytes_ - std::min(written_bytes_, *unread_bytes_);
  const auto first = std::ranges::find_if(sent_, [&](const Sent& s) { return s.end > read_bytes; });
  if (without_reader_ == WithoutReader::kCatchUp && first != sent_.end()) {
    next_ = first->sequence;
    if (place_ == Place::kLive) place_ = Place::kBehind;
  }
  sent_.clear();
  samples_sent_ns_.clear();
  followed_samples_.clear();
  written_bytes_ = 0;
  unread_bytes_.reset();
}

void PipeSink::log_state(LogLevel level, std::string state) {
  if (state == last_state_) return;
  log_at(level, "{}: {}: {}", label_, reader_->name(), state);
  last_state_ = std::move(state);
}

/// The one place that decides what is next; called whenever that may have changed.
void PipeSink::go_on() {
  if (unread_bytes_ && work_ == Work::kNone) rewind();
  if (call_) serve_call();
  if (work_ == Work::kNone && reader_state_ == ReaderState::kPresent) {
    if (place_ != Place::kLive) {
      catch_up();
    } else if (call_) {
      work_ = Work::kLive;
      send(FramePtr(call_->frame));  // it is given up where it cannot be sent
    }
  }
  if (drained_ && work_ == Work::kNone && !call_)
    asio::post(main_, std::exchange(drained_, nullptr));
}

/// Answers the call where that needs no reader.
void PipeSink::serve_call() {
  if (work_ == Work::kLive) return;
  if (reader_state_ == ReaderState::kClosed)
    return finish(Error{"write to " + reader_->name() + ": closed"});
  if (call_->frame->sequence < next_) {  // read from the files already
    live_samples_.clear();
    return finish(std::nullopt);
  }
  if (reader_state_ == ReaderState::kPresent && place_ == Place::kLive) return;
  if (without_reader_ == WithoutReader::kHold) {
    if (call_->is_cancelled) finish(Error{"write to " + reader_->name() + ": no reader"});
    return;
  }
  if (without_reader_ == WithoutReader::kCatchUp) {
    if (place_ == Place::kLive) next_ = call_->frame->sequence;
    place_ = Place::kMissed;
  }
  live_samples_.clear();  // a reader to come has others
  finish(std::nullopt);
}

/// Asks the files for the next frame that the reader lacks.
void PipeSink::catch_up() {
  work_ = Work::kCatchUp;
  place_ = Place::kBehind;
  run_in_pool(
      main_, pool_,
      [self = shared_from_this(), first = next_] {
        auto frame = self->follower_.next(first);
        return std::pair(std::move(frame), self->follower_.take_items());
      },
      [self = shared_from_this()](auto followed) {
        for (const RecordedItems& items : followed.second) {
          self->add_samples(items.stream, items.payload, self->followed_samples_);
        }
        self->on_followed(std::move(followed.first));
      });
}

void PipeSink::on_followed(Result<FramePtr> frame) {
  if (frame && frame.value()) return send(std::move(frame).value());
  work_ = Work::kNone;
  if (!frame) log_state(LogLevel::kError, "cannot catch up: " + frame.error().text);
  if (place_ == Place::kBehind) place_ = Place::kLive;
  go_on();
}

void PipeSink::send(const FramePtr& frame) {
  if (format_ == PipeFormat::kMjpeg) return on_encoded(frame, to_mjpeg(*frame, note_of(*frame)));
  run_in_pool(
      main_, pool_,
      [self = shared_from_this(), frame, note = note_of(*frame)] {
        return to_pgm(*frame, note, self->codec_);
      },
      [self = shared_from_this(), frame](Result<Block> block) {
        self->on_encoded(frame, std::move(block));
      });
}

void PipeSink::add_samples(wire::StreamId stream, const std::vector<std::uint8_t>& payload,
                           std::deque<NamedSample>& samples) const {
  const auto declared = std::ranges::find(streams_, stream, &wire::StreamDeclaration::id);
  if (declared == streams_.end()) return;
  const auto items = wire::parse_samples(declared->codec, payload);
  if (!items) return;
  for (const Sample& sample : items.value()) {
    if (!sample.message) samples.push_back({declared->name, sample});
  }
  while (samples.size() > kMostSamples) samples.pop_front();
}

/// A reader that has caught up has some from the files that are live ones as well.
void PipeSink::note_samples_sent() {
  for (auto* const samples : {&followed_samples_, &live_samples_}) {
    if (samples == &live_samples_ && work_ != Work::kLive) break;
    for (const auto& [sensor, sample] : *samples) samples_sent_ns_[sensor] = sample.time_ns;
    samples->clear();
  }
}

PipeNote PipeSink::note_of(const EncodedFrame& frame) {
  std::vector<std::string> samples;
  auto sent_ns = samples_sent_ns_;
  for (const auto* const waiting : {&followed_samples_, &live_samples_}) {
    if (waiting == &live_samples_ && work_ != Work::kLive) break;
    for (const auto& [sensor, sample] : *waiting) {
      const auto [last, is_first] = sent_ns.try_emplace(sensor, sample.time_ns);
      if (!is_first && sample.time_ns <= last->second) continue;
      last->second = sample.time_ns;
      samples.push_back(sensor + '=' + to_euroc_line(sample));
    }
  }
  std::uint64_t missed = 0;
  if (awaited_ && frame.sequence > *awaited_) missed = frame.sequence - *awaited_;
  const auto age = now_() - std::chrono::nanoseconds(frame.capture_time_ns);
  const bool is_of_today = std::chrono::abs(age) < std::chrono::hours(24);
  return {session_id_, missed, is_of_today ? std::optional(age) : std::nullopt, std::move(samples)};
}

void PipeSink::on_encoded(const FramePtr& frame, Result<Block> block) {
  if (!block) {
    log_warn("{}: {}: skipped frame {}: {}", label_, reader_->name(), frame->sequence,
             block.error().text);
    return on_sent(frame);
  }
  block_ = std::move(block).value();
  write_block(frame);
}

void PipeSink::write_block(const FramePtr& frame) {
  if (reader_state_ != ReaderState::kPresent || unread_bytes_) {
    work_ = Work::kNone;
    return go_on();
  }
  asio::async_write(
      pipe_, asio::buffer(block_),
      [self = shared_from_this(), frame](const error_code& failed, std::size_t bytes) {
        self->written_bytes_ += bytes;
        if (!failed) {
          self->note_sent(frame->sequence);
          return self->on_sent(frame);
        }
        self->work_ = Work::kNone;
        // Aborted: the pipe was closed here, and there may be a new one by now.
        if (failed != asio::error::operation_aborted) self->on_reader_left();
        self->go_on();
      });
}

void PipeSink::note_sent(Sequence sequence) {
  constexpr std::uint64_t kMostInPipe = 1 << 20;  // as far as a reader without privileges may go
  note_samples_sent();
  ++frames_read_;
  awaited_ = sequence + 1;
  sent_.push_back({sequence, written_bytes_});
  while (sent_.front().end + kMostInPipe < written_bytes_) sent_.pop_front();
}

/// All that there was to do for `frame`, the call's or one from the files, is done.
void PipeSink::on_sent(const FramePtr& frame) {
  work_ = Work::kNone;
  next_ = frame->sequence + 1;
  if (call_ && frame == call_->frame) finish(std::nullopt);
  go_on();
}

/// Answers the call, in a handler of its own: the caller may be within it.
void PipeSink::finish(std::optional<Error> error) {
  asio::post(main_, [done = std::move(call_->done), error = std::move(error)] { done(error); });
  call_.reset();
}

}  // namespace orbbuf
