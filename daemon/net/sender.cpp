// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/sender.hpp"

#include <spdlog/spdlog.h>

#include <utility>

namespace orbbuf {
namespace asio = boost::asio;
using boost::system::error_code;
using Clock = std::chrono::steady_clock;

namespace {

constexpr std::size_t kWindowFrames = 2;
constexpr std::chrono::milliseconds kWindowTime{100};
constexpr std::chrono::seconds kByeTimeout{2};

double seconds(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double>(duration).count();
}

const char* describe(const ServerLink& link) {
  if (!link.is_connected()) return ", no connection";
  return link.is_stalled() ? ", stalled" : "";
}

}  // namespace

Sender::Sender(asio::io_context& io, const LinkSettings& settings, wire::Hello hello,
               FrameBuffer& buffer, DropLog& drops)
    : buffer_(buffer),
      drops_(drops),
      drain_timeout_(settings.drain_timeout),
      link_(io, settings, std::move(hello), static_cast<ServerLink::Owner&>(*this)),
      state_timer_(io),
      report_timer_(io) {}

void Sender::start() {
  link_.start();
  report_each_second();
}

void Sender::on_connected(const wire::Position& position) {
  is_bye_sent_ = false;
  buffer_.return_in_flight();
  buffer_.resume(position.next_sequence);
  drops_.rewind(position.next_drop);
  rate_.on_connected(Clock::now());
}

void Sender::on_disconnected() {
  is_bye_sent_ = false;
  buffer_.return_in_flight();
}

void Sender::on_ack(const wire::Position& position) {
  if (const auto progress = link_.progress()) min_round_trip_ = progress->min_round_trip;
  rate_.on_acknowledged(position.next_sequence, Clock::now(), min_round_trip_);
  buffer_.acknowledge(position.next_sequence);
  drops_.acknowledge(position.next_drop);
  wake();
}

void Sender::on_bye(const wire::Position& /*position*/) {
  if (is_bye_sent_) return end(true);
  spdlog::info("link: the server is going down");
}

void Sender::on_writable() { write_next(); }

void Sender::wake() {
  if (link_.is_writable()) write_next();
}

void Sender::write_next() {
  collect_drops();
  if (reporter_.is_due()) return link_.write(next_report());
  // After an outage the drop records are many: frames first, then turn by turn.
  const bool is_drops_turn = std::exchange(is_drops_turn_, false) && drops_.has_unsent();
  if (FramePtr frame = is_drops_turn ? nullptr : choose_frame()) {
    is_drops_turn_ = true;
    spdlog::debug("link: frame {} is the kernel's from here on", frame->sequence);
    rate_.on_write(frame->sequence, frame->jpeg.size(), Clock::now());
    link_.write(std::move(frame));
  } else if (drops_.has_unsent()) {
    link_.write(wire::encode(drops_.take_unsent()));
  } else if (state_ != State::kSending && !is_bye_sent_ && is_settled()) {
    say_bye();
  }
}

/// The one place where a frame leaves the policy. Null if none waits or the window is full.
FramePtr Sender::choose_frame() {
  if (!is_window_open()) return nullptr;
  return buffer_.take();
}

/// Two round trips: one for the bytes, and one for what delays them.
bool Sender::is_window_open() const {
  const double bytes = rate_.bytes_per_s() * seconds(2 * min_round_trip_ + kWindowTime);
  return rate_.frames_in_flight() < kWindowFrames ||
         static_cast<double>(rate_.bytes_in_flight()) < bytes;
}

void Sender::collect_drops() {
  buffer_.collect_drops(collected_);
  drops_.add(collected_);
}

bool Sender::is_settled() const {
  const wire::Stats stats = buffer_.stats();
  return stats.waiting == 0 && stats.in_flight == 0 && drops_.is_settled();
}

/// Into the log, and for the server if there is something new.
void Sender::report_each_second() {
  report_timer_.expires_after(Reporter::kInterval);
  report_timer_.async_wait([this](const error_code& error) {
    if (error || state_ == State::kEnded) return;
    const wire::Stats stats = buffer_.stats();
    reporter_.look(Clock::now(), stats, link_.progress());
    spdlog::info(
        "captured {} skipped {} failed {} dropped {} acknowledged {} waiting {} in flight {}{}",
        stats.captured, stats.skipped, stats.failed, stats.dropped, stats.acknowledged,
        stats.waiting, stats.in_flight, describe(link_));
    report_each_second();
    wake();
  });
}

std::vector<std::uint8_t> Sender::next_report() {
  return wire::encode(reporter_.take(Clock::now(), buffer_.report()));
}

/// After a last report, so that the server's figures end where ours do.
void Sender::say_bye() {
  is_bye_sent_ = true;
  auto message = next_report();
  const auto bye = wire::encode(wire::Bye{{buffer_.stats().captured, drops_.next_drop()}});
  message.insert(message.end(), bye.begin(), bye.end());
  link_.write(std::move(message));
}

void Sender::finish(std::function<void(bool)> done) {
  done_ = std::move(done);
  state_ = State::kDraining;
  state_timer_.expires_after(drain_timeout_);
  state_timer_.async_wait([this](const error_code& error) {
    // A timer that has expired by then cannot be cancelled any more.
    if (!error && state_ == State::kDraining) leave();
  });
  wake();
}

void Sender::leave() {
  const wire::Stats stats = buffer_.stats();
  spdlog::warn("link: {} frames are still undelivered after {} s", stats.waiting + stats.in_flight,
               seconds(drain_timeout_));
  if (!link_.is_connected()) return end(false);
  state_ = State::kLeaving;
  buffer_.give_up_waiting();
  state_timer_.expires_after(kByeTimeout);
  state_timer_.async_wait([this](const error_code& error) {
    if (!error && state_ == State::kLeaving) end(false);
  });
  wake();
}

void Sender::end(bool complete) {
  state_ = State::kEnded;
  link_.close();
  state_timer_.cancel();
  report_timer_.cancel();
  buffer_.give_up();
  collect_drops();
  std::exchange(done_, nullptr)(complete);
}

}  // namespace orbbuf
