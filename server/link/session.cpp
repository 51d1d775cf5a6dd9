// SPDX-License-Identifier: Apache-2.0
#include "server/link/session.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <boost/asio/post.hpp>
#include <cassert>
#include <string_view>
#include <utility>

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
    case SessionEnd::kMoved:
      return "session closed, it is another server's";
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
    position_.next_sequence = std::max(position_.next_sequence, held.next_sequence);
    position_.next_drop = std::max(position_.next_drop, held.next_drop);
  }
}

void Session::fence(Fence fence) {
  if (position_ == fence.recorded) kept_ = position_;
  fence_ = std::move(fence);
}

void Session::attach(const std::shared_ptr<SessionPeer>& peer) {
  assert(!is_closing());
  const auto old = peer_.lock();
  peer_ = peer;
  is_peer_waiting_ = true;
  timer_.cancel();
  if (metrics_) metrics_->on_connected();
  if (old) old->on_replaced();
  commit();  // of what an earlier process has written
  hurry();
  on_waiter_gone();
}

void Session::detach(const SessionPeer& peer) {
  if (peer_.lock().get() != &peer) return;
  peer_.reset();
  is_peer_waiting_ = false;
  if (metrics_) metrics_->on_disconnected();
  if (is_closing()) return;
  note();
  start_timeout();
  on_waiter_gone();
}

void Session::write(FramePtr frame, Taken taken) {
  if (is_closing()) return;
  if (frame->sequence < position_.next_sequence) {
    spdlog::debug("{}: ignored frame {}, a repeat", name_, frame->sequence);
    return repeat(std::move(taken));
  }
  wire::Position then = position_;
  then.next_sequence = frame->sequence + 1;
  begin({std::move(frame), {}, then, std::move(taken)});
}

void Session::write_drops(wire::Dropped dropped, Taken taken) {
  if (is_closing()) return;
  auto& records = dropped.records;
  wire::Position then = position_;
  then.next_drop = std::max(then.next_drop, dropped.first_drop + records.size());
  if (dropped.first_drop > position_.next_drop) {
    // Only a sink that forgot its record, a pipe or a removed folder, makes the robot do that.
    spdlog::warn("{}: drop records {} to {} never came", name_, position_.next_drop,
                 dropped.first_drop - 1);
  } else {
    const auto known =
        std::min<std::uint64_t>(position_.next_drop - dropped.first_drop, records.size());
    records.erase(records.begin(), records.begin() + static_cast<std::ptrdiff_t>(known));
    dropped.first_drop += known;
  }
  if (records.empty()) return repeat(std::move(taken));
  begin({nullptr, std::move(dropped), then, std::move(taken)});
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
  if (kept_ == position_ || sinks_.empty() || std::exchange(is_committing_, true)) return;
  sinks_.front()->async_commit(
      [weak = weak_from_this(), upto = position_](const std::optional<Error>& error) {
        if (const auto self = weak.lock()) self->on_committed(upto, error);
      });
}

void Session::on_committed(const wire::Position& upto, const std::optional<Error>& error) {
  is_commit_failed_ = error.has_value();
  if (error) {  // is_committing_ stays, so nothing more is acknowledged
    note_failure(error);
    if (is_closing()) settle();
    return;
  }
  if (!fence_) return on_recorded(upto);
  fence_->record(upto, [weak = weak_from_this(), upto](bool is_ours) {
    const auto self = weak.lock();
    if (!self) return;
    is_ours ? self->on_recorded(upto) : self->on_not_ours();
  });
  if (is_closing() || is_peer_waiting_) hurry();
}

void Session::on_recorded(const wire::Position& upto) {
  is_committing_ = false;
  kept_ = upto;
  if (const auto peer = peer_.lock()) peer->on_kept();
  commit();
  settle();
}

/// is_committing_ stays, so nothing more is acknowledged.
void Session::on_not_ours() {
  is_commit_failed_ = true;
  if (is_closing()) return settle();
  spdlog::warn("{}: another server has this session; from frame {} on it is that one's", name_,
               kept_.next_sequence);
  close(SessionEnd::kMoved);
}

void Session::hurry() const {
  if (fence_ && is_committing_) fence_->hurry();
}

/// The server stops, though its fence does not answer.
void Session::give_up_recording() {
  if (!fence_ || kept_ == position_) return;
  is_commit_failed_ = true;
  settle();
}

void Session::move(std::string address) {
  move_to_ = std::move(address);
  close(SessionEnd::kMoved);
}

void Session::on_report(const wire::Report& report) {
  if (metrics_) metrics_->on_report(report);
  const wire::Stats& stats = report.stats;
  closing_.stats = stats;
  closing_.clock_offset_ns = report.clock_offset_ns;
  const auto now = std::chrono::steady_clock::now();
  if (!noted_ || now - noted_at_ >= kNoteInterval) note();
  spdlog::debug(
      "{}: captured {} = skipped {} + failed {} + dropped {} + acknowledged {} + waiting {} + "
      "in flight {}",
      name_, stats.captured, stats.skipped, stats.failed, stats.dropped, stats.acknowledged,
      stats.waiting, stats.in_flight);
}

void Session::on_late(bool is_present_session) {
  if (metrics_) metrics_->on_late(is_present_session);
}

void Session::on_spool(const wire::Spool& spool) {
  if (!metrics_) return;
  std::uint64_t present = 0;
  std::uint64_t all = 0;
  for (const wire::SpooledSession& session : spool.sessions) {
    all += session.frames;
    if (session.session_id == info_.session_id) present += session.frames;
  }
  metrics_->on_spool(present, all);
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
  const auto& [captured, drops] = bye.position;
  if (captured < position_.next_sequence || drops != position_.next_drop) {
    spdlog::warn(
        "{}: the robot's bye does not fit: {} frames captured, {} dropped; the record has "
        "frames up to {}, {} dropped",
        name_, captured, drops, position_.next_sequence, position_.next_drop);
  }
  closing_.has_ended = true;
  if (!closing_.stats) closing_.stats.emplace();
  closing_.stats->captured = captured;
}

void Session::begin(Job job) {
  assert(!job_);
  job_ = std::move(job);
  call_sink();
}

/// To the job's present sink. The session may be gone before that answers.
void Session::call_sink() {
  is_sink_busy_ = true;
  auto done = [weak = weak_from_this()](const std::optional<Error>& error) {
    if (const auto self = weak.lock()) self->on_sink_done(error);
  };
  FrameSink& sink = *sinks_[job_->sink];
  if (job_->frame) {
    sink.async_write(job_->frame, std::move(done));
  } else {
    sink.async_write_drops(job_->dropped, std::move(done));
  }
}

/// One step of the job: the next sink, another try in a second, or the end of it.
void Session::on_sink_done(const std::optional<Error>& error) {
  is_sink_busy_ = false;
  const bool can_give_up = is_closing() || (!job_->taken && !is_partly_taken());
  if (error && can_give_up) {
    job_.reset();
    return settle();
  }
  note_failure(error);
  if (error) {
    if (events_.sink_failed) events_.sink_failed();
    if (const auto peer = peer_.lock()) peer->on_kept();  // a sign of life
    retry_.expires_after(kRetry);
    retry_.async_wait([self = shared_from_this()](const error_code& failed) {
      if (!failed && self->job_ && !self->is_sink_busy_) self->call_sink();
    });
    return;
  }
  if (++job_->sink < sinks_.size()) return call_sink();
  position_ = job_->then;
  show_job();
  const Taken taken = std::move(job_->taken);
  job_.reset();
  commit();
  if (taken) return taken();
  settle();
}

/// One sink has the job, or one has a part of it.
bool Session::is_partly_taken() const { return job_->sink > 0 || sinks_[0]->is_partly_taken(); }

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
  } else {
    metrics_->on_dropped(job_->dropped.records);
  }
}

void Session::note_failure(const std::optional<Error>& error) {
  if (is_failing_ == error.has_value()) return;
  is_failing_ = error.has_value();
  if (error) {
    spdlog::error("{}: stream paused: {}", name_, error->text);
    if (metrics_) metrics_->on_paused(error->text);
  } else {
    spdlog::info("{}: stream resumed", name_);
    if (metrics_) metrics_->on_resumed();
  }
}

/// The connection that waited for the job is gone: ends the job, as far as that can be done.
void Session::on_waiter_gone() {
  if (!job_) return settle();
  job_->taken = nullptr;
  if (is_sink_busy_) return sinks_[job_->sink]->cancel();
  if (is_partly_taken() && !is_closing()) return;  // it must go on to those that lack it
  retry_.cancel();
  job_.reset();
  settle();
}

/// Does what had to wait for the sinks.
void Session::settle() {
  if (job_ || (kept_ != position_ && !(is_commit_failed_ && is_closing()))) return;
  if (is_closing()) {
    if (!std::exchange(is_draining_, true)) drain();
    return;
  }
  if (!std::exchange(is_peer_waiting_, false)) return;
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
  if (is_closing()) return;
  end_ = end;
  hurry();
  timer_.expires_after(timeouts_.drain);
  timer_.async_wait([self = shared_from_this()](const error_code& failed) {
    if (failed) return;
    for (const auto& sink : self->sinks_) sink->close();
    if (self->end_ == SessionEnd::kStopping) self->give_up_recording();
  });
  if (end == SessionEnd::kMoved) {
    for (const auto& sink : sinks_) sink->pass_on();
  }
  on_waiter_gone();
}

/// All that was begun has ended: one sink after the other finishes.
void Session::drain() {
  if (drained_ == sinks_.size()) return finish_close();
  sinks_[drained_]->async_drain(closing_, [self = shared_from_this()] {
    ++self->drained_;
    self->drain();
  });
}

/// All that was begun has ended: the sinks are closed before the end is reported, so that a
/// reader's end and a robot's bye mean that nothing more follows.
void Session::finish_close() {
  const auto self = shared_from_this();  // `closed` may drop the last reference
  timer_.cancel();
  show_losses();
  if (metrics_) metrics_->on_ended();
  for (const auto& sink : std::exchange(sinks_, {})) sink->close();
  spdlog::info("{}: {}; next frame {}, {} drop records", name_, to_string(*end_),
               position_.next_sequence, position_.next_drop);
  if (const auto peer = peer_.lock()) {
    if (*end_ == SessionEnd::kSuperseded) {
      peer->on_replaced();
    } else if (*end_ == SessionEnd::kMoved) {
      peer->on_moved(move_to_);
    } else {
      peer->on_ended(kept_);
    }
  }
  events_.closed();
}

}  // namespace orbbuf
