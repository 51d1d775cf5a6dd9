// SPDX-License-Identifier: Apache-2.0
#include "server/link/session.hpp"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <cassert>
#include <string_view>
#include <utility>

#include "common/log.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using boost::system::error_code;

std::string_view to_string(SessionEnd end) {
  switch (end) {
    case SessionEnd::kBye:
      return "the robot ended the session";
    case SessionEnd::kSuperseded:
      return "session closed, the robot has begun another";
    case SessionEnd::kAbandoned:
      return "session closed, the robot did not come back";
    case SessionEnd::kStopping:
      return "session closed, the server stops";
    case SessionEnd::kDraining:
      return "session closed, the server drains";
    case SessionEnd::kUnkept:
      return "session closed, its frames cannot be kept any more";
  }
  return "";
}

}  // namespace

Session::Session(asio::io_context& main, SessionInfo info,
                 std::vector<std::shared_ptr<FrameSink>> sinks, const Timeouts& timeouts,
                 Events events)
    : main_(main),
      info_(std::move(info)),
      name_(info_.robot_id + " " + info_.session_id),
      sinks_(std::move(sinks)),
      timeouts_(timeouts),
      events_(std::move(events)),
      timer_(main),
      retry_(main) {
  // Only sinks that outlive the server remember; the others begin where those stand.
  for (const auto& sink : sinks_) {
    const wire::Position held = sink->position();
    for (wire::StreamId id = 0; id < wire::kMostStreams; ++id) {
      position_[id] = std::max(position_[id], held[id]);
    }
  }
}

void Session::attach(const std::shared_ptr<SessionPeer>& peer) {
  assert(!is_closing());
  const auto old = peer_.lock();
  peer_ = peer;
  peer_state_ = PeerState::kWaiting;
  timer_.cancel();
  if (metrics_) metrics_->on_connected();
  if (old) old->on_replaced();
  commit();  // of what an earlier process has written
  on_waiter_gone();
}

void Session::detach(const SessionPeer& peer) {
  if (peer_.lock().get() != &peer) return;
  peer_.reset();
  peer_state_ = PeerState::kNone;
  if (metrics_) metrics_->on_disconnected();
  if (is_closing()) return;
  note();
  start_timeout();
  on_waiter_gone();
}

void Session::write(FramePtr frame, Taken taken) {
  if (is_closing()) return;
  if (frame->sequence < position_[wire::kFrames]) {
    log_debug("{}: ignored frame {}, a repeat", name_, frame->sequence);
    return repeat(std::move(taken));
  }
  const bool is_jpeg = frame->jpeg.size() > 1 && frame->jpeg[0] == 0xFF && frame->jpeg[1] == 0xD8;
  if (!is_jpeg && !std::exchange(has_no_jpeg_, true)) {
    log_warn("{}: frame {} is no JPEG; it is kept as it came", name_, frame->sequence);
  }
  wire::Position then = position_;
  then[wire::kFrames] = frame->sequence + 1;
  begin({std::move(frame), {}, then, std::move(taken)});
}

void Session::write_items(ItemsPtr items, std::uint64_t count, Taken taken) {
  if (is_closing()) return;
  const wire::StreamId stream = items->stream;
  if (items->first < position_[stream]) return repeat(std::move(taken));
  if (items->first > position_[stream]) {
    // Samples come late or are lost. Others: only a sink that forgot its record, a pipe or a
    // removed folder, makes the robot do that; or a topic of which only the latest is sent.
    auto& limit = gaps_.try_emplace(stream, std::chrono::seconds(10)).first->second;
    if (limit.lets_through())
      log_warn("{}: items {} to {} of stream {} did not come live", name_, position_[stream],
               items->first - 1, stream);
  }
  wire::Position then = position_;
  then[stream] = items->first + count;
  begin({nullptr, std::move(items), then, std::move(taken)});
}

/// It is acknowledged as well: the robot may have missed the first acknowledgement.
void Session::repeat(Taken taken) {
  asio::post(main_, [weak = weak_from_this(), taken = std::move(taken)] {
    const auto self = weak.lock();
    const auto peer = self ? self->peer_.lock() : nullptr;
    if (peer && self->kept_ == self->position_) peer->on_kept();
    taken();
  });
}

/// One commit at a time; the next takes all that was taken meanwhile.
void Session::commit() {
  if (kept_ == position_ || sinks_.empty() || keeping_ != Keeping::kIdle) return;
  keeping_ = Keeping::kBusy;
  sinks_.front()->async_commit(
      [weak = weak_from_this(), upto = position_](const std::optional<Error>& error) {
        if (const auto self = weak.lock()) self->on_committed(upto, error);
      });
}

void Session::on_committed(const wire::Position& upto, const std::optional<Error>& error) {
  if (error) {
    note_failure(error);
    keeping_ = Keeping::kFailed;                          // nothing more is acknowledged
    if (const auto peer = peer_.lock()) peer->on_kept();  // with the reason
    if (is_closing()) settle();
    return;
  }
  keeping_ = Keeping::kIdle;
  kept_ = upto;
  if (const auto peer = peer_.lock()) peer->on_kept();
  commit();
  settle();
}

void Session::step_aside(bool has_device_failed) {
  if (is_closing()) return;
  if (has_device_failed) return close(SessionEnd::kUnkept);
  const auto now = std::chrono::steady_clock::now();
  const auto peer = peer_.lock();
  if (!peer || !job_ || failures_ < 2 || now < stays_until_) return;
  stays_until_ = now + kStay;
  peer->on_sent_away(pause_);
}

void Session::on_report(const wire::Report& report) {
  if (metrics_) metrics_->on_report(report);
  const wire::Stats& stats = report.stats;
  closing_.stats = stats;
  closing_.clock_offset_ns = report.clock_offset_ns;
  const auto now = std::chrono::steady_clock::now();
  if (!noted_ || now - noted_at_ >= kNoteInterval) note();
  log_debug(
      "{}: captured {} = skipped {} + failed {} + dropped {} + acknowledged {} + waiting {} + "
      "in flight {}",
      name_, stats.captured, stats.skipped, stats.failed, stats.dropped, stats.acknowledged,
      stats.waiting, stats.in_flight);
}

void Session::on_late(bool is_present_session) {
  if (metrics_) metrics_->on_late(is_present_session);
}

void Session::on_account(const wire::Account& account) {
  if (!metrics_) return;
  held_[account.session_id] = account.held;
  if (account.held == 0) held_.erase(account.session_id);
  std::uint64_t all = 0;
  for (const auto& [session_id, frames] : held_) all += frames;
  const auto present = held_.find(info_.session_id);
  metrics_->on_spool(present == held_.end() ? 0 : present->second, all);
}

/// So that the record has them even if this process dies.
void Session::note() {
  SessionClosing reported = closing_;
  reported.has_ended = false;
  if (!reported.stats || reported == noted_ || is_closing()) return;
  noted_ = reported;
  noted_at_ = std::chrono::steady_clock::now();
  for (const auto& sink : sinks_) sink->note(*noted_);
}

void Session::on_bye(const wire::Bye& bye) {
  const auto captured = bye.position[wire::kFrames];
  const auto drops = bye.position[wire::kDrops];
  if (captured < position_[wire::kFrames] || drops != position_[wire::kDrops]) {
    log_warn(
        "{}: the robot's bye does not fit: {} frames captured, {} dropped; the record has "
        "frames up to {}, {} dropped",
        name_, captured, drops, position_[wire::kFrames], position_[wire::kDrops]);
  }
  closing_.has_ended = true;
  if (!closing_.stats) closing_.stats.emplace();
  closing_.stats->captured = captured;
}

void Session::begin(Job job) {
  assert(!job_);
  job_ = std::move(job);
  job_->sink = next_sink(0);
  if (job_->sink < sinks_.size()) return call_sink();
  Taken taken = std::move(job_->taken);  // items that no sink wants
  finish_job();
  repeat(std::move(taken));
}

/// The first from `sink` on that is to have the job.
std::size_t Session::next_sink(std::size_t sink) const {
  while (sink < sinks_.size() && !job_->frame && !sinks_[sink]->takes_items()) ++sink;
  return sink;
}

/// To the job's present sink. The session may be gone before that answers.
void Session::call_sink() {
  job_->is_in_sink = true;
  auto done = [weak = weak_from_this()](const std::optional<Error>& error) {
    if (const auto self = weak.lock()) self->on_sink_done(error);
  };
  FrameSink& sink = *sinks_[job_->sink];
  if (job_->frame) {
    sink.async_write(job_->frame, std::move(done));
  } else {
    sink.async_write_items(job_->items, std::move(done));
  }
}

/// One step of the job: the next sink, another try in a second, or the end of it.
void Session::on_sink_done(const std::optional<Error>& error) {
  job_->is_in_sink = false;
  const bool can_give_up = is_closing() || (!job_->taken && job_->sink == 0);
  if (error && can_give_up) {
    job_.reset();
    return settle();
  }
  note_failure(error);
  if (error) {
    ++failures_;
    return try_again([this] {
      if (job_ && !job_->is_in_sink) call_sink();
    });
  }
  failures_ = 0;
  job_->sink = next_sink(job_->sink + 1);
  if (job_->sink < sinks_.size()) return call_sink();
  const Taken taken = std::move(job_->taken);
  finish_job();
  if (taken) return taken();
  settle();
}

void Session::try_again(std::function<void()> work) {
  if (events_.sink_failed) events_.sink_failed();
  if (const auto peer = peer_.lock()) peer->on_kept();  // a sign of life
  retry_.expires_after(kRetry);
  retry_.async_wait([self = shared_from_this(), work = std::move(work)](const error_code& failed) {
    if (!failed) work();
  });
}

/// All sinks have it.
void Session::finish_job() {
  show_job();
  position_ = job_->then;
  job_.reset();
  commit();
}

void Session::show_losses() const {
  if (!metrics_) return;
  std::uint64_t lost = 0;
  for (const auto& sink : sinks_) lost += sink->lost();
  metrics_->on_lost(lost);
}

void Session::show_job() const {
  if (!metrics_) return;
  show_losses();
  if (job_->frame) {
    metrics_->on_delivered(job_->frame);
  } else if (job_->items->stream == wire::kDrops) {
    metrics_->on_dropped(wire::parse_drops(job_->items->payload).value());
  } else {
    show_samples(*job_->items);
  }
}

/// Before the position moves behind them.
void Session::show_samples(const wire::Items& items) const {
  const auto stream = std::ranges::find(info_.streams, items.stream, &wire::StreamDeclaration::id);
  if (stream == info_.streams.end()) return;
  metrics_->on_samples(stream->name, position_[items.stream], items.first,
                       wire::parse_samples(stream->codec, items.payload).value());
}

void Session::note_failure(const std::optional<Error>& error) {
  if (pause_.empty() != error.has_value() || (!error && keeping_ == Keeping::kFailed)) return;
  pause_ = error ? error->text : "";
  if (error) {
    log_error("{}: stream paused: {}", name_, error->text);
    if (metrics_) metrics_->on_paused(error->text);
  } else {
    log_info("{}: stream resumed", name_);
    if (metrics_) metrics_->on_resumed();
  }
}

/// The connection that waited for the job is gone: ends the job, as far as that can be done.
void Session::on_waiter_gone() {
  if (!job_) return settle();
  job_->taken = nullptr;
  if (job_->is_in_sink) return sinks_[job_->sink]->cancel();
  if (job_->sink > 0 && !is_closing()) return;  // it must go on to those that lack it
  retry_.cancel();
  job_.reset();
  settle();
}

/// Does what had to wait for the sinks.
void Session::settle() {
  const bool is_unkept = kept_ != position_ && !(keeping_ == Keeping::kFailed && is_closing());
  if (job_ || is_unkept || life_ == Life::kDraining) return;
  if (life_ == Life::kClosing) {
    life_ = Life::kDraining;
    return drain();
  }
  if (peer_state_ != PeerState::kWaiting) return;
  peer_state_ = PeerState::kAttached;
  if (const auto peer = peer_.lock()) peer->on_attached(kept_);
}

/// The connection is gone; the robot has this long to come back.
void Session::start_timeout() {
  timer_.expires_after(timeouts_.connection);
  timer_.async_wait([self = shared_from_this()](const error_code& failed) {
    const bool is_over = !failed && self->timer_.expiry() <= std::chrono::steady_clock::now();
    if (is_over && self->peer_.expired()) self->close(SessionEnd::kAbandoned);
  });
}

void Session::close(SessionEnd end) {
  is_stopping_ = is_stopping_ || end == SessionEnd::kStopping;
  if (is_closing()) return;
  life_ = Life::kClosing;
  end_ = end;
  timer_.expires_after(timeouts_.drain);
  timer_.async_wait([self = shared_from_this()](const error_code& failed) {
    if (failed) return;
    for (const auto& sink : self->sinks_) sink->close();
  });
  on_waiter_gone();
}

/// All that was begun has ended: one sink after the other finishes.
void Session::drain() {
  if (drained_ == sinks_.size()) return finish_close();
  sinks_[drained_]->async_drain(
      closing_,
      [self = shared_from_this()](const std::optional<Error>& error) { self->on_drained(error); });
}

void Session::on_drained(const std::optional<Error>& error) {
  note_failure(error);
  const bool is_overdue = timer_.expiry() <= std::chrono::steady_clock::now();
  if (error && end_ != SessionEnd::kUnkept && !(is_stopping_ && is_overdue))
    return try_again([this] { drain(); });
  is_end_lost_ = is_end_lost_ || error;
  ++drained_;
  drain();
}

/// All that was begun has ended: the sinks are closed before the end is reported, so that a
/// reader's end and a robot's bye mean that nothing more follows.
void Session::finish_close() {
  const auto self = shared_from_this();  // `closed` may drop the last reference
  timer_.cancel();
  show_losses();
  if (metrics_) metrics_->on_ended();
  for (const auto& sink : std::exchange(sinks_, {})) sink->close();
  log_info("{}: {}; next frame {}, {} drop records", name_, to_string(end_),
           position_[wire::kFrames], position_[wire::kDrops]);
  if (const auto peer = peer_.lock()) {
    if (end_ == SessionEnd::kSuperseded) {
      peer->on_replaced();
    } else if (end_ == SessionEnd::kUnkept) {
      peer->on_sent_away(pause_.empty() ? "its disk has failed" : pause_);
    } else if (is_end_lost_) {
      peer->on_end_lost();
    } else {
      peer->on_ended(kept_);
    }
  }
  events_.closed();
}

}  // namespace orbbuf
