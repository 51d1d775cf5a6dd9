// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/server_link.hpp"

#include <spdlog/spdlog.h>

#include <utility>

#include "common/seconds.hpp"

namespace orbbuf {
namespace asio = boost::asio;
using boost::system::error_code;
using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

namespace {

constexpr milliseconds kShortestRetryDelay{125};
constexpr milliseconds kLongestRetryDelay{375};
constexpr milliseconds kWatchInterval{100};
constexpr unsigned kAttemptsBeforeResolvingAgain = 20;

}  // namespace

ServerLink::ServerLink(asio::io_context& io, LinkSettings settings, wire::Hello hello, Owner& owner)
    : io_(io),
      settings_(std::move(settings)),
      tls_(make_tls_context(settings_.tls)),
      hello_(std::move(hello)),
      owner_(owner),
      resolver_(io),
      attempt_timer_(io),
      watch_timer_(io),
      random_(std::random_device{}()),
      stall_watch_(settings_.stall_timeout) {}

ServerLink::~ServerLink() { close(); }

void ServerLink::start() {
  if (!tls_ && !is_loopback(settings_.server)) {
    spdlog::warn(
        "link: plain TCP to {}: whoever is on the way can see and change the frames; "
        "docs/security.md says how to set up [tls]",
        to_string(settings_.server));
  }
  attempt();
  watch();
}

void ServerLink::close() {
  state_ = State::kClosed;
  for (auto* open : {&attempt_, &connection_}) {
    if (*open) (*open)->close();
    open->reset();
  }
  attempt_timer_.cancel();
  watch_timer_.cancel();
  resolver_.cancel();
}

std::optional<TcpProgress> ServerLink::progress() const {
  return connection_ ? connection_->progress() : std::nullopt;
}

void ServerLink::attempt() {
  if (endpoints_.empty()) return resolve();
  connect();
}

void ServerLink::resolve() {
  const auto on_resolved = [this](const error_code& error,
                                  const asio::ip::tcp::resolver::results_type& results) {
    if (error == asio::error::operation_aborted || state_ == State::kClosed) return;
    if (error) {
      return on_attempt_failed({"cannot resolve " + settings_.server.host + ": " + error.message()},
                               retry_delay());
    }
    endpoints_.assign(results.begin(), results.end());
    if (is_attempt_due()) connect();
  };
  resolver_.async_resolve(settings_.server.host, std::to_string(settings_.server.port),
                          on_resolved);
}

void ServerLink::connect() {
  attempt_ = std::make_shared<ServerConnection>(io_, tls_.get(),
                                                static_cast<ServerConnection::Owner&>(*this));
  attempt_->open(endpoints_[attempts_ % endpoints_.size()], settings_.server.host, hello_,
                 static_cast<std::uint32_t>(settings_.unsent_bytes));
  start_attempt_timer();
}

void ServerLink::start_attempt_timer() {
  attempt_timer_.expires_after(settings_.connect_timeout);
  attempt_timer_.async_wait([this, attempt = attempt_](const error_code& error) {
    if (error || attempt != attempt_ || attempt_timer_.expiry() > Clock::now()) return;
    on_attempt_failed({fmt::format("no answer within {} s", to_seconds(settings_.connect_timeout))},
                      milliseconds(0));
  });
}

void ServerLink::attempt_later(std::chrono::nanoseconds delay) {
  // A name may come to mean another address while a robot is out of reach.
  if (++attempts_ % kAttemptsBeforeResolvingAgain == 0) endpoints_.clear();
  attempt_timer_.expires_after(delay);
  attempt_timer_.async_wait([this](const error_code& error) {
    if (!error && is_attempt_due()) attempt();
  });
}

/// Asked by what may come late: a timer or a resolver that was cancelled.
bool ServerLink::is_attempt_due() const {
  return !attempt_ && (state_ == State::kConnecting || state_ == State::kStalled);
}

std::chrono::nanoseconds ServerLink::retry_delay() {
  return milliseconds(std::uniform_int_distribution<milliseconds::rep>(
      kShortestRetryDelay.count(), kLongestRetryDelay.count())(random_));
}

void ServerLink::on_attempt_failed(const Error& why, std::chrono::nanoseconds delay) {
  has_tried_ = true;
  if (attempt_) attempt_->close();
  attempt_.reset();
  if (!connection_ && why.text != last_error_) {
    spdlog::warn("link: no connection to {}: {}; trying on", to_string(settings_.server), why.text);
    last_error_ = why.text;
  }
  attempt_later(delay);
}

void ServerLink::on_connection_lost(const Error& why) {
  connection_.reset();
  const bool was_stalled = std::exchange(state_, State::kConnecting) == State::kStalled;
  owner_.on_disconnected();
  spdlog::log(was_stalled ? spdlog::level::info : spdlog::level::warn,
              "link: connection to {} lost: {}", to_string(settings_.server), why.text);
  if (!was_stalled) attempt_later(retry_delay());  // else another is on its way already
}

void ServerLink::on_failed(const ServerConnection& from, const Error& error) {
  if (&from == attempt_.get()) return on_attempt_failed(error, retry_delay());
  on_connection_lost(error);
}

void ServerLink::on_step(const ServerConnection& from) {
  if (&from == attempt_.get()) start_attempt_timer();
}

void ServerLink::on_welcome(const wire::Position& position) {
  has_tried_ = true;
  attempt_timer_.cancel();
  if (connection_) connection_->close();  // the server has left it for this one
  connection_ = std::move(attempt_);
  state_ = State::kConnected;
  attempts_ = 0;
  last_error_.clear();
  stall_watch_.restart(Clock::now());
  spdlog::info("link: connected to {}{}; its record of this session reaches frame {}",
               to_string(settings_.server), tls_ ? " over TLS" : "", position.next_sequence);
  owner_.on_connected(position);
}

void ServerLink::on_ack(const wire::Position& position) { owner_.on_ack(position); }

void ServerLink::on_bye(const wire::Position& position) { owner_.on_bye(position); }

void ServerLink::on_writable() { owner_.on_writable(); }

void ServerLink::watch() {
  watch_timer_.expires_after(kWatchInterval);
  watch_timer_.async_wait([this](const error_code& error) {
    if (error || state_ == State::kClosed) return;
    if (connection_) check_stall();
    watch();
  });
}

void ServerLink::check_stall() {
  stall_watch_.look(connection_->progress(), Clock::now());
  if (stall_watch_.is_moving()) return on_recovered();
  if (state_ == State::kStalled || !stall_watch_.is_stalled()) return;
  state_ = State::kStalled;
  spdlog::warn("link: connection to {} stalled, nothing acknowledged for {:.1f} s; trying another",
               to_string(settings_.server), to_seconds(stall_watch_.still_for()));
  attempt();
}

/// Once another has said hello the server may have left this one for it: then the attempt is seen
/// through, and the server says which of the two it has left.
void ServerLink::on_recovered() {
  if (state_ != State::kStalled || (attempt_ && attempt_->has_said_hello())) return;
  state_ = State::kConnected;
  resolver_.cancel();
  attempt_timer_.cancel();
  if (attempt_) attempt_->close();
  attempt_.reset();
  attempts_ = 0;
  spdlog::info("link: connection to {} recovered", to_string(settings_.server));
}

}  // namespace orbbuf
