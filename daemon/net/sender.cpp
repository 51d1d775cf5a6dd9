// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/sender.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "common/log.hpp"
#include "common/seconds.hpp"

namespace orbbuf {

using boost::system::error_code;
using Clock = std::chrono::steady_clock;

namespace {

constexpr std::chrono::seconds kByeTimeout{2};
constexpr std::chrono::milliseconds kAhead{2};  // a frame is written before the link is free

}  // namespace

Sender::Sender(boost::asio::io_context& io, const LinkSettings& settings, wire::Hello hello,
               FrameBuffer& buffer, Record& record, SampleStreams& samples)
    : buffer_(buffer),
      record_(record),
      drain_timeout_(settings.drain_timeout),
      link_(io, settings, std::move(hello), static_cast<ServerLink::Owner&>(*this)),
      backfill_(io, record, [this] { wake(); }),
      drain_timer_(io),
      report_timer_(io),
      samples_(samples) {
  if (record_.keeps_frames()) buffer_.keep_for_record();
}

void Sender::start() {
  reporter_.start(Clock::now());
  link_.start();
  report_each_second();
}

void Sender::on_connected(const wire::Position& position) {
  on_disconnected();  // from the connection that this one replaces, if there is one
  buffer_.resume(position[wire::kFrames]);
  if (position[wire::kFrames] < confirmed_) {
    log_error(
        "link: the server has lost frames that it had acknowledged, from {} to {}: the drop record "
        "names those of the newest {} as lost",
        position[wire::kFrames], confirmed_ - 1, FrameBuffer::kMostRemembered);
  }
  confirmed_ = position[wire::kFrames];
  drops_.rewind(position[wire::kDrops]);
  samples_.on_connected(position, [this](wire::StreamId id) { return link_.takes(id); });
  backfill_.on_connected(link_.takes(wire::kLate), link_.takes(wire::kAccounts),
                         link_.max_frame_bytes());
}

bool Sender::can_be_at(const wire::Position& position) const {
  return position[wire::kFrames] <= written_end_ && position[wire::kDrops] <= drops_.end() &&
         samples_.can_be_at(position);
}

void Sender::on_disconnected() {
  is_bye_sent_ = false;
  rate_.on_lost();
  chosen_.reset();
  buffer_.return_in_flight();
  backfill_.on_disconnected();
}

void Sender::on_ack(const wire::Ack& ack) {
  const auto& position = ack.position;
  rate_.on_received(Clock::now(), ack.received, measure_round_trip());
  buffer_.acknowledge(position[wire::kFrames]);
  confirmed_ = std::max(confirmed_, position[wire::kFrames]);
  drops_.acknowledge(position[wire::kDrops]);
  samples_.on_ack(position);
  backfill_.on_ack(position);
  wake();
}

void Sender::on_bye(const wire::Position& position) {
  backfill_.on_ack(position);
  if (is_bye_sent_) return end(true);
  log_info("link: the server is going down");
}

void Sender::wake() {
  if (link_.is_writable()) return write_next();
  collect();  // so that the buffer does not keep those of a long outage
}

void Sender::on_pushed() {
  backfill_.on_captured(Clock::now());
  samples_.on_frame(buffer_.last_capture_time_ns());
  wake();
  if (buffer_.stats().waiting > 0) {
    buffer_.look_ahead(moment(Clock::now(), measure_round_trip()));
  }
}

/// False: there are none.
bool Sender::write(const std::optional<wire::Items>& items) {
  if (!items) return false;
  backfill_.on_written(Clock::now(), link_.write(*items), rate_.bytes_per_s());
  return true;
}

void Sender::write_next() {
  collect();
  if (reporter_.is_due()) return write_report();
  if (done_ && buffer_.stats().waiting == 0) samples_.on_last_frame_sent();
  // After an outage the drop records are many: frames first, then turn by turn.
  const bool is_drops_turn = std::exchange(is_drops_turn_, false) && drops_.has_unsent();
  const auto round_trip = measure_round_trip();
  if (!chosen_ && !is_drops_turn) chosen_ = take_frame(round_trip);
  if (chosen_) {
    // The post of on_pushed() may be behind.
    samples_.on_frame(chosen_->capture_time_ns);
    if (!write(samples_.take_message(chosen_->capture_time_ns))) write_chosen();
  } else if (!is_drops_turn &&
             write(done_ ? samples_.take_message(std::numeric_limits<std::int64_t>::max())
                         : samples_.take_batch())) {
    // Frames and drop records go when the link is free again.
  } else if (drops_.has_unsent()) {
    const auto [first, records] = drops_.take_unsent(wire::kMaxDropsPerMessage);
    write(wire::Items{wire::kDrops, first, wire::encode_drops(records)});
  } else if (done_ && !is_bye_sent_ && is_settled()) {
    say_bye();
  } else if (!done_) {
    write_late(round_trip);
  }
}

void Sender::write_chosen() {
  is_drops_turn_ = true;
  written_end_ = std::max(written_end_, chosen_->sequence + 1);
  link_.write(std::exchange(chosen_, nullptr));
}

/// Nothing live waits for the link.
void Sender::write_late(std::chrono::nanoseconds round_trip) {
  const auto now = Clock::now();
  if (write(backfill_.take_account(now)) || !is_live(now, round_trip)) return;
  if (write(backfill_.take_part(now, rate_.bytes_per_s(), rate_.served_at(round_trip)))) {
    backfill_.on_part_written();
  }
}

/// A frame that is overdue waits in the link's queue: a late one would hold up the next.
bool Sender::is_live(Clock::time_point now, std::chrono::nanoseconds round_trip) const {
  return buffer_.stats().waiting == 0 && rate_.has_room(now, round_trip) &&
         !rate_.is_overdue(now, round_trip) && !link_.is_stalled();
}

FramePtr Sender::take_frame(std::chrono::nanoseconds round_trip) {
  const auto now = Clock::now();
  if (!rate_.has_room(now, round_trip)) return nullptr;
  const SendMoment moment = this->moment(now, round_trip);
  FramePtr frame = buffer_.take(moment);
  while (frame && is_too_large(*frame)) {
    buffer_.refuse_newest();
    frame = buffer_.take(moment);
  }
  if (!frame) return nullptr;
  rate_.on_written(now, frame->sequence, frame->jpeg.size());
  backfill_.on_written(now, frame->jpeg.size(), rate_.bytes_per_s());
  log_debug("link: frame {} is the kernel's from here on", frame->sequence);
  collect();  // those that were passed over for it
  samples_.on_frame_sent(frame->capture_time_ns);
  return frame;
}

SendMoment Sender::moment(Clock::time_point now, std::chrono::nanoseconds round_trip) const {
  SendMoment moment{now.time_since_epoch(), rate_.bytes_per_s(now, round_trip)};
  if (done_) moment.end = drain_timer_.expiry().time_since_epoch();
  moment.is_busy = rate_.served_at(round_trip) > now + kAhead;
  return moment;
}

bool Sender::is_too_large(const EncodedFrame& frame) {
  const auto limit = link_.max_frame_bytes();
  if (limit == 0 || frame.jpeg.size() <= limit) return false;
  if (!std::exchange(is_refusal_logged_, true)) {
    log_error(
        "link: frame {} has {} bytes, more than the server's listen.max_frame of {}: dropped as "
        "refused, and so are all that are larger",
        frame.sequence, frame.jpeg.size(), limit);
  }
  return true;
}

void Sender::collect(bool those_at_risk) {
  buffer_.collect_drops(collected_);
  samples_.on_frames_dropped(collected_);
  drops_.add(collected_);
  record_.give_up(collected_);
  buffer_.collect_for_record(for_record_, those_at_risk);
  for (FramePtr& frame : for_record_.frames) record_.keep(std::move(frame));
  for (const Sequence sequence : for_record_.delivered) record_.release(sequence);
  record_.set_live_from(for_record_.first_undelivered);
}

void Sender::note_progress() {
  SessionProgress progress{buffer_.stats().captured, buffer_.last_capture_time_ns(), confirmed_,
                           drops_.settled_below(confirmed_)};
  const auto keep = [this](const wire::Items& items) { return record_.keep(items); };
  const auto send_late = [this](wire::StreamId stream, const SampleQueue::Range& late) {
    return record_.send_late(stream, late.begin, late.end);
  };
  for (auto& [stream, captured, first_waiting] : samples_.record(keep, send_late)) {
    progress.streams.push_back({std::move(stream), captured, first_waiting});
  }
  record_.note(progress);
}

bool Sender::is_settled() const {
  const wire::Stats stats = buffer_.stats();
  return stats.waiting == 0 && stats.in_flight == 0 && drops_.is_settled() && samples_.is_settled();
}

std::chrono::nanoseconds Sender::measure_round_trip() const {
  const auto progress = link_.progress();
  return progress ? progress->least_round_trip : std::chrono::microseconds(0);
}

void Sender::write_report() {
  auto report = next_report();
  backfill_.on_written(Clock::now(), report.size(), rate_.bytes_per_s());
  link_.write(std::move(report));
}

std::vector<std::uint8_t> Sender::next_report() {
  auto report = reporter_.take(Clock::now(), buffer_.report());
  report.clock_offset_ns = clock_offset_.count();
  report.captured_items = samples_.captured();
  return wire::encode(report);
}

/// After a last report, so that the server's stats are those of the end.
void Sender::say_bye() {
  is_bye_sent_ = true;
  std::vector<std::uint8_t> message;
  const auto add = [&](const std::vector<std::uint8_t>& part) {
    message.insert(message.end(), part.begin(), part.end());
  };
  note_progress();
  while (const auto account = backfill_.take_account(Clock::now(), true)) {
    add(wire::encode(*account));
  }
  add(next_report());
  wire::Position end{buffer_.stats().captured, drops_.end()};
  samples_.put_ends(end);
  add(wire::encode(wire::Bye{end}));
  link_.write(std::move(message));
}

void Sender::report_each_second() {
  report_timer_.expires_after(std::chrono::seconds(1));
  report_timer_.async_wait([this](const error_code& error) {
    if (!error && link_.state() != ServerLink::State::kClosed) report_each_second();
  });
  if (!reporter_.is_time(Clock::now())) return;
  const wire::Stats stats = buffer_.stats();
  reporter_.look(Clock::now(), stats, link_.progress());
  collect(true);
  const auto spooled = this->spooled();
  const auto samples = samples_.stats();
  log_info(
      "captured {} skipped {} failed {} dropped {} acknowledged {} waiting {} in flight {}{}{}{}{}",
      stats.captured, stats.skipped, stats.failed, stats.dropped, stats.acknowledged, stats.waiting,
      stats.in_flight, spooled ? fmt::format(" spooled {}", *spooled) : "",
      !link_.is_connected()    ? ", no connection"
      : !link_.pause().empty() ? ", the server takes nothing"
      : link_.is_stalled()     ? ", stalled"
                               : "",
      samples.empty() ? "" : "; ", samples);
  wake();
  note_progress();
}

std::optional<std::uint64_t> Sender::spooled() const {
  return record_.keeps_frames() ? std::optional(record_.stats().held) : std::nullopt;
}

void Sender::finish(std::function<void(bool)> done) {
  done_ = std::move(done);
  not_kept_ = record_.stats().not_kept;
  drain_timer_.expires_after(drain_timeout_);
  drain_timer_.async_wait([this](const error_code& error) {
    if (!error && done_) give_up_waiting();
  });
  wake();
}

void Sender::abandon() {
  if (!std::exchange(done_, nullptr)) not_kept_ = record_.stats().not_kept;
  end(false);
}

void Sender::give_up_waiting() {
  const wire::Stats stats = buffer_.stats();
  const auto samples = samples_.stats();
  log_warn("link: {} frames are still undelivered after {} s{}{}", stats.waiting + stats.in_flight,
           to_seconds(drain_timeout_), samples.empty() ? "" : "; ", samples);
  if (!link_.is_connected()) return end(false);
  buffer_.give_up_waiting();
  lost_ = stats.waiting - std::min(stats.waiting, buffer_.stats().waiting);
  drain_timer_.expires_after(kByeTimeout);
  drain_timer_.async_wait([this](const error_code& error) {
    if (!error && done_) end(false);
  });
  wake();
}

void Sender::end(bool complete) {
  link_.close();
  backfill_.on_disconnected();
  drain_timer_.cancel();
  report_timer_.cancel();
  const wire::Stats left = buffer_.stats();
  buffer_.give_up();
  collect();
  lost_ = record_.keeps_frames() ? record_.stats().not_kept - not_kept_
                                 : lost_ + left.waiting + left.in_flight;
  note_progress();
  record_.end();
  if (const auto done = std::exchange(done_, nullptr)) done(complete);
}

}  // namespace orbbuf
