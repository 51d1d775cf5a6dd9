// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/link.hpp"

#include <spdlog/spdlog.h>

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
constexpr unsigned kAttemptsBeforeResolvingAgain = 20;

double seconds(std::chrono::nanoseconds duration) {
  return std::chrono::duration<double>(duration).count();
}

}  // namespace

Link::Link(asio::io_context& io, LinkSettings settings, wire::Hello hello, Owner& owner)
    : io_(io),
      settings_(std::move(settings)),
      tls_(make_tls_context(settings_.tls)),
      hello_(std::move(hello)),
      owner_(owner),
      resolver_(io),
      attempt_timer_(io),
      random_(std::random_device{}()),
      tick_timer_(io),
      stall_watch_(settings_.stall_timeout) {}

Link::~Link() {
  for (const auto& open : {attempt_, connection_}) {
    if (open) open->close();
  }
}

void Link::start() {
  if (!tls_ && !is_loopback(settings_.server)) {
    spdlog::warn(
        "link: plain TCP to {}: anyone on the path can read and change the frames; "
        "docs/security.md says how to set up [tls]",
        to_string(settings_.server));
  }
  resolve();
  tick();
}

void Link::resolve() {
  const auto on_resolved = [this](const error_code& error,
                                  const asio::ip::tcp::resolver::results_type& results) {
    if (error == asio::error::operation_aborted || is_ended_) return;
    if (error) {
      return on_attempt_failed({"cannot resolve " + settings_.server.host + ": " + error.message()},
                               retry_delay());
    }
    endpoints_.assign(results.begin(), results.end());
    if (is_wanting_attempt()) connect();
  };
  resolver_.async_resolve(settings_.server.host, std::to_string(settings_.server.port),
                          on_resolved);
}

void Link::connect() {
  attempt_ = std::make_shared<ServerConnection>(io_, tls_.get(),
                                                static_cast<ServerConnection::Owner&>(*this));
  attempt_->open(endpoints_[attempts_ % endpoints_.size()], settings_.server.host, hello_,
                 static_cast<std::uint32_t>(settings_.unsent_bytes));
  start_attempt_timer();
}

void Link::start_attempt_timer() {
  attempt_timer_.expires_after(settings_.connect_timeout);
  attempt_timer_.async_wait([this, attempt = attempt_](const error_code& error) {
    if (error || attempt != attempt_ || attempt_timer_.expiry() > Clock::now()) return;
    on_attempt_failed({fmt::format("no answer within {} s", seconds(settings_.connect_timeout))},
                      milliseconds(0));
  });
}

void Link::connect_again(std::chrono::nanoseconds delay) {
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
bool Link::is_wanting_attempt() const {
  return !is_ended_ && !attempt_ && (!connection_ || is_stalled_);
}

std::chrono::nanoseconds Link::retry_delay() {
  return milliseconds(std::uniform_int_distribution<milliseconds::rep>(
      kShortestRetryDelay.count(), kLongestRetryDelay.count())(random_));
}

void Link::on_attempt_failed(const Error& why, std::chrono::nanoseconds delay) {
  has_tried_ = true;
  if (attempt_) attempt_->close();
  attempt_.reset();
  if (!connection_ && why.text != last_error_) {
    spdlog::warn("link: no connection to {}: {}; trying again", to_string(settings_.server),
                 why.text);
    last_error_ = why.text;
  }
  connect_again(delay);
}

void Link::on_connection_lost(const Error& why) {
  connection_.reset();
  const bool was_stalled = std::exchange(is_stalled_, false);
  spdlog::log(was_stalled ? spdlog::level::info : spdlog::level::warn,
              "link: connection to {} lost: {}", to_string(settings_.server), why.text);
  if (!was_stalled) connect_again(retry_delay());  // else another is on its way already
  owner_.on_lost();
}

void Link::on_failed(const ServerConnection& from, const Error& error) {
  if (&from == attempt_.get()) return on_attempt_failed(error, retry_delay());
  on_connection_lost(error);
}

void Link::on_step(const ServerConnection& from) {
  if (&from == attempt_.get()) start_attempt_timer();
}

void Link::on_welcome(const wire::Position& position) {
  has_tried_ = true;
  attempt_timer_.cancel();
  if (connection_) connection_->close();  // the server has left it for this one
  connection_ = std::move(attempt_);
  attempts_ = 0;
  last_error_.clear();
  is_stalled_ = false;
  stall_watch_.restart(Clock::now());
  spdlog::info("link: connected to {}{}; its record of this session reaches frame {}",
               to_string(settings_.server), tls_ ? " over TLS" : "", position.next_sequence);
  owner_.on_connected(position);
}

void Link::tick() {
  tick_timer_.expires_after(kTick);
  tick_timer_.async_wait([this](const error_code& error) {
    if (!error && !is_ended_) tick();
  });
  progress_ = connection_ ? connection_->progress() : std::nullopt;
  if (connection_) check_stall();
  owner_.on_tick();
}

void Link::check_stall() {
  stall_watch_.look(progress_, Clock::now());
  if (stall_watch_.is_moving()) return on_recovered();
  if (is_stalled_ || !stall_watch_.is_stalled()) return;
  is_stalled_ = true;
  spdlog::warn("link: connection to {} stalled, nothing acknowledged for {:.1f} s; trying another",
               to_string(settings_.server), seconds(stall_watch_.still_for()));
  if (endpoints_.empty()) return resolve();
  connect();
}

/// Once another has said hello the server may have left this one for it: then it must be seen
/// through, and the connection that the server has left will be closed by it.
void Link::on_recovered() {
  if (!is_stalled_ || (attempt_ && attempt_->has_said_hello())) return;
  is_stalled_ = false;
  resolver_.cancel();
  attempt_timer_.cancel();
  if (attempt_) attempt_->close();
  attempt_.reset();
  attempts_ = 0;
  spdlog::info("link: connection to {} recovered", to_string(settings_.server));
}

void Link::end() {
  is_ended_ = true;
  for (auto* open : {&attempt_, &connection_}) {
    if (*open) (*open)->close();
    open->reset();
  }
  for (auto* timer : {&attempt_timer_, &tick_timer_}) timer->cancel();
  resolver_.cancel();
}

}  // namespace orbbuf
