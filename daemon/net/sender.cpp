// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/sender.hpp"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <utility>

namespace orbbuf {
namespace asio = boost::asio;
using boost::system::error_code;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

namespace {

constexpr milliseconds kShortestRetryDelay{125};
constexpr milliseconds kLongestRetryDelay{375};
constexpr milliseconds kTick{100};
constexpr std::chrono::seconds kByeTimeout{2};
constexpr unsigned kAttemptsBeforeResolvingAgain = 20;
constexpr std::size_t kWindowFrames = 3;
constexpr milliseconds kWindowTime{100};

double seconds(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace

Sender::Sender(asio::io_context& io, LinkSettings settings, wire::Hello hello, FrameBuffer& buffer,
               DropLog& drops)
    : io_(io),
      settings_(std::move(settings)),
      tls_(make_tls_context(settings_.tls)),
      hello_(std::move(hello)),
      buffer_(buffer),
      drops_(drops),
      resolver_(io),
      attempt_timer_(io),
      random_(std::random_device{}()),
      tick_timer_(io),
      drain_timer_(io),
      stall_watch_(settings_.stall_timeout) {}

Sender::~Sender() {
  for (const auto& open : {attempt_, connection_}) {
    if (open) open->close();
  }
}

void Sender::start() {
  if (!tls_ && !is_loopback(settings_.server)) {
    spdlog::warn(
        "link: plain TCP to {}: whoever is on the way can see and change the frames; "
        "docs/security.md says how to set up [tls]",
        to_string(settings_.server));
  }
  reporter_.start(Clock::now());
  resolve();
  tick();
}

void Sender::resolve() {
  const auto on_resolved = [this](const error_code& error,
                                  const asio::ip::tcp::resolver::results_type& results) {
    if (error == asio::error::operation_aborted || is_ended_) return;
    if (error) {
      return attempt_failed({"cannot resolve " + settings_.server.host + ": " + error.message()},
                            retry_delay());
    }
    endpoints_.assign(results.begin(), results.end());
    if (is_wanting_attempt()) connect();
  };
  resolver_.async_resolve(settings_.server.host, std::to_string(settings_.server.port),
                          on_resolved);
}

void Sender::connect() {
  attempt_ = std::make_shared<ServerConnection>(io_, tls_.get(),
                                                static_cast<ServerConnection::Owner&>(*this));
  attempt_->open(endpoints_[attempts_ % endpoints_.size()], settings_.server.host, hello_,
                 static_cast<std::uint32_t>(settings_.unsent_bytes));
  start_attempt_timer();
}

void Sender::start_attempt_timer() {
  attempt_timer_.expires_after(settings_.connect_timeout);
  attempt_timer_.async_wait([this, attempt = attempt_](const error_code& error) {
    if (error || attempt != attempt_ || attempt_timer_.expiry() > Clock::now()) return;
    attempt_failed({fmt::format("no answer within {} s", seconds(settings_.connect_timeout))},
                   milliseconds(0));
  });
}

void Sender::connect_again(std::chrono::nanoseconds delay) {
  // A name may come to mean another address while a robot is out of reach.
  if (++attempts_ % kAttemptsBeforeResolvingAgain == 0) endpoints_.clear();
  attempt_timer_.expires_after(delay);
  attempt_timer_.async_wait([this](const error_code& error) {
    if (error || !is_wanting_attempt()) return;
    if (endpoints_.empty()) return resolve();
    connect();
  });
}

/// Asked by what may come late: a timer or a resolver that was cancelled.
bool Sender::is_wanting_attempt() const {
  return !is_ended_ && !attempt_ && (!connection_ || is_stalled_);
}

std::chrono::nanoseconds Sender::retry_delay() {
  return milliseconds(std::uniform_int_distribution<milliseconds::rep>(
      kShortestRetryDelay.count(), kLongestRetryDelay.count())(random_));
}

void Sender::attempt_failed(const Error& why, std::chrono::nanoseconds delay) {
  has_tried_ = true;
  if (attempt_) attempt_->close();
  attempt_.reset();
  if (!connection_ && why.text != last_error_) {
    spdlog::warn("link: no connection to {}: {}; trying on", to_string(settings_.server), why.text);
    last_error_ = why.text;
  }
  connect_again(delay);
}

void Sender::connection_lost(const Error& why) {
  connection_.reset();
  is_bye_sent_ = false;
  buffer_.return_in_flight();
  const bool was_stalled = std::exchange(is_stalled_, false);
  spdlog::log(was_stalled ? spdlog::level::info : spdlog::level::warn,
              "link: connection to {} lost: {}", to_string(settings_.server), why.text);
  if (!was_stalled) connect_again(retry_delay());  // else another is on its way already
}

void Sender::on_failed(const ServerConnection& from, const Error& error) {
  if (&from == attempt_.get()) return attempt_failed(error, retry_delay());
  connection_lost(error);
}

void Sender::on_step(const ServerConnection& from) {
  if (&from == attempt_.get()) start_attempt_timer();
}

void Sender::on_welcome(const wire::Position& position) {
  has_tried_ = true;
  attempt_timer_.cancel();
  if (connection_) {  // the server has left it for this one
    connection_->close();
    buffer_.return_in_flight();
    is_bye_sent_ = false;
  }
  connection_ = std::move(attempt_);
  attempts_ = 0;
  last_error_.clear();
  is_stalled_ = false;
  stall_watch_.restart(Clock::now());
  link_rate_.on_connected(Clock::now());
  buffer_.resume(position.next_sequence);
  drops_.rewind(position.next_drop);
  spdlog::info("link: connected to {}{}; its record of this session reaches frame {}",
               to_string(settings_.server), tls_ ? " over TLS" : "", position.next_sequence);
}

void Sender::on_ack(const wire::Position& position) {
  const auto progress = connection_->progress();
  if (progress) min_round_trip_ = progress->min_round_trip;
  link_rate_.on_acknowledged(position.next_sequence, Clock::now(), min_round_trip_);
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
  if (connection_ && connection_->is_writable()) write_next();
}

void Sender::write_next() {
  collect_drops();
  if (reporter_.is_due()) return connection_->write(next_report());
  // After an outage the drop records are many: frames first, then turn by turn.
  const bool is_drops_turn = std::exchange(is_drops_turn_, false) && drops_.has_unsent();
  const bool is_frames_turn = !is_drops_turn && is_window_open();
  if (FramePtr frame = is_frames_turn ? buffer_.take() : nullptr) {
    is_drops_turn_ = true;
    spdlog::debug("link: frame {} is the kernel's from here on", frame->sequence);
    link_rate_.on_write(frame->sequence, frame->jpeg.size(), Clock::now());
    connection_->write(std::move(frame));
  } else if (drops_.has_unsent()) {
    connection_->write(wire::encode(drops_.take_unsent()));
  } else if (done_ && !is_bye_sent_ && is_settled()) {
    say_bye();
  }
}

/// As much as link and server take in two round trips, one for the bytes and one for what delays
/// them, and 100 ms of jitter.
bool Sender::is_window_open() const {
  const double bytes = link_rate_.bytes_per_s() * seconds(2 * min_round_trip_ + kWindowTime);
  return link_rate_.frames_in_flight() < kWindowFrames ||
         static_cast<double>(link_rate_.bytes_in_flight()) < bytes;
}

void Sender::collect_drops() {
  buffer_.collect_drops(collected_);
  drops_.add(collected_);
}

bool Sender::is_settled() const {
  const wire::Stats stats = buffer_.stats();
  return stats.waiting == 0 && stats.in_flight == 0 && drops_.is_settled();
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
  connection_->write(std::move(message));
}

void Sender::tick() {
  tick_timer_.expires_after(kTick);
  tick_timer_.async_wait([this](const error_code& error) {
    if (!error && !is_ended_) tick();
  });
  const auto progress = connection_ ? connection_->progress() : std::nullopt;
  if (connection_) check_stall(progress);
  if (!reporter_.is_time(Clock::now())) return;
  const wire::Stats stats = buffer_.stats();
  reporter_.look(Clock::now(), stats, progress);
  spdlog::info(
      "captured {} skipped {} failed {} dropped {} acknowledged {} waiting {} in flight {}{}",
      stats.captured, stats.skipped, stats.failed, stats.dropped, stats.acknowledged, stats.waiting,
      stats.in_flight,
      !connection_  ? ", no connection"
      : is_stalled_ ? ", stalled"
                    : "");
  wake();
}

void Sender::check_stall(const std::optional<TcpProgress>& progress) {
  stall_watch_.look(progress, Clock::now());
  if (stall_watch_.is_moving()) return moved();
  if (is_stalled_ || !stall_watch_.is_stalled()) return;
  is_stalled_ = true;
  spdlog::warn("link: connection to {} stalled, nothing acknowledged for {:.1f} s; trying another",
               to_string(settings_.server), seconds(stall_watch_.still_for()));
  if (endpoints_.empty()) return resolve();
  connect();
}

/// Once another has said hello the server may have left this one for it: then it must be seen
/// through, and whichever the server has left will say so.
void Sender::moved() {
  if (!is_stalled_ || (attempt_ && attempt_->has_said_hello())) return;
  is_stalled_ = false;
  resolver_.cancel();
  attempt_timer_.cancel();
  if (attempt_) attempt_->close();
  attempt_.reset();
  attempts_ = 0;
  spdlog::info("link: connection to {} moves again", to_string(settings_.server));
}

void Sender::finish(std::function<void(bool)> done) {
  done_ = std::move(done);
  drain_timer_.expires_after(settings_.drain_timeout);
  drain_timer_.async_wait([this](const error_code& error) {
    if (!error && done_) give_up_waiting();
  });
  wake();
}

void Sender::give_up_waiting() {
  const wire::Stats stats = buffer_.stats();
  spdlog::warn("link: {} frames are still undelivered after {} s", stats.waiting + stats.in_flight,
               seconds(settings_.drain_timeout));
  if (!connection_) return end(false);
  buffer_.give_up_waiting();
  drain_timer_.expires_after(kByeTimeout);
  drain_timer_.async_wait([this](const error_code& error) {
    if (!error && done_) end(false);
  });
  wake();
}

void Sender::end(bool complete) {
  is_ended_ = true;
  for (auto* open : {&attempt_, &connection_}) {
    if (*open) (*open)->close();
    open->reset();
  }
  for (auto* timer : {&attempt_timer_, &tick_timer_, &drain_timer_}) timer->cancel();
  resolver_.cancel();
  buffer_.give_up();
  collect_drops();
  std::exchange(done_, nullptr)(complete);
}

}  // namespace orbbuf
