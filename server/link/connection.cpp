// SPDX-License-Identifier: Apache-2.0
#include "server/link/connection.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/ssl/error.hpp>
#include <boost/asio/write.hpp>
#include <utility>

#include "common/keep_alive.hpp"
#include "common/sample.hpp"
#include "server/runtime/listen_on.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using asio::ip::tcp;
using boost::system::error_code;
using wire::ErrorCode;

constexpr std::chrono::seconds kPartingTime{1};
constexpr std::uint64_t kMostAside = 8;
constexpr std::chrono::seconds kLongestHold{5};  // of live frames, by these

}  // namespace

Connection::Connection(tcp::socket socket, std::shared_ptr<TlsContext> tls,
                       const ListenSettings& settings, ConnectionOwner& owner)
    : peer_(peer_of(socket)),
      tls_(std::move(tls)),
      stream_(std::move(socket), tls_.get()),
      settings_(settings),
      owner_(owner),
      timer_(stream_.get_executor()),
      reader_(settings.max_frame_bytes),
      late_(settings.max_frame_bytes) {}

void Connection::start() {
  error_code ignored;  // acks are then merely later
  stream_.socket().set_option(tcp::no_delay(true), ignored);
  // For the time in which a sink is busy and the idle timer does not run; else that is sooner.
  const int socket = stream_.socket().native_handle();
  keep_alive(socket);
  limit_retransmission_interval(socket, std::chrono::seconds(1));
  limit_unacknowledged_time(socket);
  start_timer(settings_.hello_timeout);
  if (stream_.is_tls()) return shake_hands();
  read();
}

void Connection::shake_hands() {
  state_ = State::kHandshake;
  stream_.async_handshake_as_server([self = shared_from_this()](const error_code& failed) {
    if (self->state_ != State::kHandshake) return;
    if (failed) return self->on_handshake_failed(failed);
    self->state_ = State::kHello;
    self->read();
  });
}

void Connection::on_handshake_failed(const error_code& failed) {
  const bool has_left = failed == asio::error::eof || failed == asio::error::connection_reset ||
                        failed == asio::ssl::error::stream_truncated;
  if (has_left) return on_read_failed(failed);
  if (!Stream::is_peer_plain(failed)) return fail({ErrorCode::kRefused, stream_.explain(failed)});
  // A robot without [tls] can read the answer, and tries less often after a refusal.
  log_warn("{}: {}", name(), stream_.explain(failed));
  stream_.go_bare();
  state_ = State::kHello;
  part(encode(wire::ErrorMessage{
      ErrorCode::kRefused,
      "this server speaks TLS: set [tls] on the robot (orbbuf-server add-robot makes its keys)"}));
}

void Connection::join(std::shared_ptr<Session> session) {
  session_ = std::move(session);
  state_ = State::kJoining;
  session_->attach(shared_from_this());
}

void Connection::refuse(std::string_view why, LogLevel level) {
  fail({ErrorCode::kRefused, std::string(why)}, level);
}

void Connection::on_attached(wire::Position position) {
  state_ = State::kServing;
  log_info("{}: session {} at frame {}, {}", name(), session_->info().session_id,
           position[wire::kFrames], software_);
  wire::Welcome welcome;
  welcome.position = position;
  welcome.max_frame_bytes = settings_.max_frame_bytes;
  welcome.takes.set(wire::kFrames).set(wire::kDrops);
  if (owner_.stores() != nullptr) welcome.takes.set(wire::kLate).set(wire::kAccounts);
  for (const auto& stream : session_->info().streams) welcome.takes.set(stream.id);
  welcome.has_heartbeat = true;
  takes_ = welcome.takes;
  send(encode(welcome));
  read();
}

void Connection::on_kept() {
  if (state_ != State::kServing) return;
  is_ack_due_ = true;
  send_next();
}

void Connection::on_replaced() {
  log_info("{}: replaced, the robot connected again", name());
  part(encode(wire::ErrorMessage{ErrorCode::kReplaced, "the robot connected again"}));
}

void Connection::on_sent_away(const std::string& why) {
  log_info("{}: sent away", name());
  part(encode(wire::ErrorMessage{ErrorCode::kSentAway, "this server cannot keep frames: " + why}));
}

void Connection::read() {
  if (state_ == State::kServing) start_timer(settings_.idle_timeout);
  const auto space =
      state_ == State::kParting ? std::span<std::uint8_t>(discarded_) : reader_.space();
  is_reading_ = true;
  stream_.async_read_some(asio::buffer(space.data(), space.size()),
                          [self = shared_from_this()](const error_code& failed, std::size_t bytes) {
                            self->is_reading_ = false;
                            self->on_bytes(failed, bytes);
                          });
}

/// The one place where the stream advances: each call either reads on, or hands over to handle(),
/// which does so when it is done, or ends the connection.
void Connection::on_bytes(const error_code& failed, std::size_t bytes) {
  if (state_ == State::kClosed) return;
  if (failed) return on_read_failed(failed);
  if (state_ == State::kParting) return read();
  const auto is_complete = reader_.commit(bytes);
  if (!is_complete) return fail(is_complete.error());
  if (!is_complete.value()) return read();
  handle(reader_.take());
}

void Connection::on_read_failed(const error_code& failed) {
  has_peer_closed_ = true;
  if (state_ == State::kParting) {
    if (!is_writing_) close();
    return;
  }
  const bool is_between = reader_.is_between_messages();
  const char* const when = is_introduced() ? "" : " before hello";
  // A robot's attempts overlap, and it closes all but the first that connects.
  const auto level = !is_between       ? LogLevel::kWarn
                     : is_introduced() ? LogLevel::kInfo
                                       : LogLevel::kDebug;
  log_at(level, "{}: connection lost{}: {}", name(), is_between ? when : " within a message",
         stream_.explain(failed));
  close();
}

void Connection::handle(Message message) {
  const wire::Type type = message.header.type;
  if (state_ == State::kHello) {
    return handle_hello(message);
  }
  stop_timer();  // from here on it is the sinks that take their time
  switch (type) {
    case wire::Type::kFrame:
      return handle_frame(std::move(message));
    case wire::Type::kItems:
      return handle_items(message);
    case wire::Type::kStats: {
      const auto report = wire::parse_stats(message.header, message.body);
      if (!report) return fail(report.error());
      session_->on_report(report.value());
      return read();
    }
    case wire::Type::kBye: {
      const auto bye = wire::parse_bye(message.header, message.body);
      if (!bye) return fail(bye.error());
      session_->on_bye(bye.value());
      return session_->close(SessionEnd::kBye);
    }
    case wire::Type::kError: {
      const auto error = wire::parse_error(message.header, message.body);
      if (!error) return fail(error.error());
      log_warn("{}: the robot reports: {}", name(), error.value().text);
      return close();
    }
    default:
      return fail({ErrorCode::kUnexpected, fmt::format("unexpected {}", to_string(type))});
  }
}

void Connection::handle_hello(const Message& message) {
  const auto hello = wire::parse_hello(message.header, message.body);
  if (!hello) return fail(hello.error());
  robot_id_ = hello.value().robot_id;
  software_ = hello.value().software;
  const auto& [min, max] = std::pair(hello.value().min_version, hello.value().max_version);
  if (min > wire::kProtocolVersion || max < wire::kOldestProtocolVersion) {
    return fail({ErrorCode::kVersion,
                 fmt::format("the robot speaks protocol {} to {}, we speak {} to {}", min, max,
                             wire::kOldestProtocolVersion, wire::kProtocolVersion)});
  }
  const std::string certified = stream_.is_tls() ? stream_.peer_name() : robot_id_;
  if (certified != robot_id_) {
    return refuse(fmt::format("the certificate is for \"{}\", not for this robot",
                              wire::is_valid_id(certified) ? certified : ""));
  }
  stop_timer();
  owner_.on_hello(shared_from_this(), hello.value());
}

bool Connection::expect_near(const char* what, std::uint64_t number, std::uint64_t position) {
  if (can_follow(number, position)) return true;
  fail({ErrorCode::kUnexpected,
        fmt::format("{} {} cannot follow position {}", what, number, position)});
  return false;
}

void Connection::handle_frame(Message message) {
  auto frame = wire::parse_frame(message.header, message.meta, std::move(message.body));
  if (!frame) return fail(frame.error());
  const auto next = session_->position()[wire::kFrames];
  if (!expect_near("frame", frame.value().sequence, next)) return;
  session_->write(std::make_shared<const EncodedFrame>(std::move(frame).value()),
                  [weak = weak_from_this()] {
                    if (const auto self = weak.lock()) self->on_taken();
                  });
}

void Connection::handle_items(const Message& message) {
  auto items = wire::parse_items(message.header, message.body);
  if (!items) return fail(items.error());
  const wire::StreamId stream = items.value().stream;
  if (!takes_[stream]) {
    return fail({ErrorCode::kUnexpected, fmt::format("items of stream {}, which this server does "
                                                     "not take",
                                                     stream)});
  }
  if (stream == wire::kLate) return handle_late(items.value());
  if (stream == wire::kAccounts) return handle_account(items.value());
  const auto count =
      stream == wire::kDrops ? check_drops(items.value()) : check_samples(items.value());
  if (!count) return;
  const auto [first, next] = std::pair(items.value().first, session_->position()[stream]);
  if (!expect_near("item", first, next)) return;
  if (first < next && next < first + *count) {
    return fail({ErrorCode::kUnexpected, fmt::format("items {} to {} of stream {}, of which {} is "
                                                     "the next",
                                                     first, first + *count - 1, stream, next)});
  }
  session_->write_items(std::make_shared<const wire::Items>(std::move(items).value()), *count,
                        [weak = weak_from_this()] {
                          if (const auto self = weak.lock()) self->on_taken();
                        });
}

/// How many they are; nothing: the connection has failed.
std::optional<std::uint64_t> Connection::check_drops(const wire::Items& items) {
  const auto records = wire::parse_drops(items.payload);
  if (!records) {
    fail(records.error());
    return std::nullopt;
  }
  for (const DropRecord& record : records.value()) {
    const auto frame = session_->position()[wire::kFrames];
    if (!expect_near("a drop record of frame", record.end() - 1, frame)) return std::nullopt;
  }
  return records.value().size();
}

/// Likewise.
std::optional<std::uint64_t> Connection::check_samples(const wire::Items& items) {
  const auto samples = wire::parse_samples(session_->info().streams, items.stream, items.payload);
  if (samples) return samples.value().size();
  fail(samples.error());
  return std::nullopt;
}

void Connection::handle_late(const wire::Items& items) {
  const auto part = wire::parse_late_part(items.payload);
  if (!part) return fail(part.error());
  auto late = late_.add(items.first, part.value());
  if (!late) return fail(late.error());
  if (!late.value()) return read();
  if (is_discarding_) return discard(late_writes_);
  const bool is_present = late.value()->session_id == session_->info().session_id;
  const bool is_frame = !late.value()->items;
  owner_.stores()->write_late(
      robot_id_, std::move(*late.value()), weak_from_this(),
      [weak = weak_from_this(), number = late_writes_.begin(), is_present,
       is_frame](const Result<bool>& is_new) {
        const auto self = weak.lock();
        if (!self) return;
        self->on_aside_kept(self->late_writes_, number, is_new);
        if (is_frame && is_new && is_new.value() && self->session_)
          self->session_->on_late(is_present);
      },
      when_written(&Connection::late_writes_));
  read_aside();
}

void Connection::handle_account(const wire::Items& items) {
  auto account = wire::parse_account(items.payload);
  if (!account) return fail(account.error());
  std::erase_if(account.value().streams, [](const wire::StreamAccount& each) {
    return !wire::is_sample_stream(each.stream);
  });
  if (items.first != account_writes_.begun) {
    return fail({ErrorCode::kUnexpected,
                 fmt::format("account {}, not {}", items.first, account_writes_.begun)});
  }
  if (is_discarding_) return discard(account_writes_);
  owner_.stores()->take_account(
      robot_id_, account.value(), weak_from_this(),
      [weak = weak_from_this(), number = account_writes_.begin(),
       account = account.value()](const Result<bool>& kept) {
        const auto self = weak.lock();
        if (!self) return;
        if (kept && self->session_) self->session_->on_account(account);
        self->on_aside_kept(self->account_writes_, number, kept);
      },
      when_written(&Connection::account_writes_));
  read_aside();
}

void Connection::on_aside_kept(Aside& writes, std::uint64_t number, const Result<bool>& kept) {
  if (!kept) return fail({ErrorCode::kUnexpected, kept.error().text});
  writes.kept_on.insert(number);
  while (writes.kept_on.erase(writes.kept) > 0) ++writes.kept;
  on_kept();
}

SessionStores::Written Connection::when_written(Aside Connection::*writes) {
  return [weak = weak_from_this(), writes] {
    const auto self = weak.lock();
    if (!self) return;
    ++(*self.*writes).written;
    self->on_aside_written();
  };
}

void Connection::on_aside_written() {
  if (state_ != State::kServing) return;
  if (is_held_) read_aside();
  if (!is_discarding_ || late_writes_.count() + account_writes_.count() > 0) return;
  if (late_writes_.discarded + account_writes_.discarded == 0) {
    is_discarding_ = false;  // the disk was merely slow
  } else {
    fail({ErrorCode::kTimeout, "late frames can be written again: their robot sends them anew"},
         LogLevel::kInfo);
  }
}

/// The stream is read on while they are written, so that they do not hold the live frames. If they
/// cannot be written, those that follow are discarded: none is acknowledged before these are kept,
/// so the robot sends them again on its next connection.
void Connection::read_aside() {
  is_held_ = late_writes_.count() >= kMostAside || account_writes_.count() >= kMostAside;
  if (!is_held_) return read();
  start_timer(kLongestHold);
}

void Connection::discard(Aside& writes) {
  writes.discard();
  read();
}

void Connection::on_taken() {
  if (state_ != State::kServing) return;
  if (session_->received() > received_) {
    is_ack_due_ = true;
    send_next();
  }
  read();
}

void Connection::fail(const wire::Fault& fault, LogLevel level) {
  log_at(level, "{}: {}", name(), fault.text);
  part(encode(wire::ErrorMessage{fault.code, fault.text}));
}

/// Leaves the session to others at once; what remains is the robot's farewell.
void Connection::part(std::vector<std::uint8_t> last_words) {
  if (state_ == State::kParting || state_ == State::kClosed) return;
  if (state_ == State::kHandshake) {  // there is no talking to it, but OpenSSL may have told it why
    last_words.clear();
    stream_.go_bare();
  }
  state_ = State::kParting;
  if (const auto session = std::exchange(session_, nullptr)) session->detach(*this);
  is_ack_due_ = false;
  start_timer(kPartingTime);
  send(std::move(last_words));
  if (!is_reading_) read();
}

void Connection::send(std::vector<std::uint8_t> message) {
  waiting_.insert(waiting_.end(), message.begin(), message.end());
  send_next();
}

/// Whatever is to be written, in this order: the waiting message, an ack of all there is by now,
/// and our side's end once the last words are out.
void Connection::send_next() {
  if (is_writing_) return;
  if (!waiting_.empty()) {
    out_ = std::exchange(waiting_, {});
  } else if (is_ack_due_) {
    received_ = session_->received();
    wire::Ack ack{session_->kept(), received_, session_->pause()};
    ack.position[wire::kLate] = late_writes_.kept;
    ack.position[wire::kAccounts] = account_writes_.kept;
    out_ = encode(ack);
    is_ack_due_ = false;
  } else if (state_ == State::kParting) {
    if (has_peer_closed_) return close();
    error_code ignored;  // if that fails the connection is gone, which reading shows
    stream_.socket().shutdown(tcp::socket::shutdown_send, ignored);
    return;
  } else {
    return;
  }
  is_writing_ = true;
  asio::async_write(stream_, asio::buffer(out_),
                    [self = shared_from_this()](const error_code& failed, std::size_t) {
                      self->is_writing_ = false;
                      // What broke the connection is told by reading it, sooner or later.
                      if (!failed && self->state_ != State::kClosed) self->send_next();
                    });
}

void Connection::close() {
  if (state_ == State::kClosed) return;
  state_ = State::kClosed;
  const auto self = shared_from_this();  // the owner lets go of it
  if (const auto session = std::exchange(session_, nullptr)) session->detach(*this);
  timer_.cancel();
  error_code ignored;  // there is nothing to do about it
  stream_.socket().close(ignored);
  owner_.on_closed(self);
}

/// Each message moves the deadline, which costs nothing: the timer that runs finds out when it
/// ends.
void Connection::start_timer(std::chrono::nanoseconds time) {
  deadline_ = std::chrono::steady_clock::now() + time;
  if (!is_timer_running_ || deadline_ < timer_.expiry()) await_deadline();
}

/// Replaces the timer that runs, even one whose handler is already on its way.
void Connection::await_deadline() {
  is_timer_running_ = true;
  timer_.expires_at(deadline_);
  timer_.async_wait([self = shared_from_this()](const error_code& failed) {
    const auto now = std::chrono::steady_clock::now();
    if (failed || self->timer_.expiry() > now) return;
    self->is_timer_running_ = false;
    if (self->deadline_ <= now) return self->on_deadline();
    if (self->deadline_ < std::chrono::steady_clock::time_point::max()) self->await_deadline();
  });
}

void Connection::on_deadline() {
  if (state_ == State::kParting) return close();
  const bool is_serving = state_ == State::kServing;
  if (is_introduced() && !is_serving) return;
  if (std::exchange(is_held_, false)) {
    is_discarding_ = true;
    return read();
  }
  const std::chrono::duration<double> limit =
      is_serving ? settings_.idle_timeout : settings_.hello_timeout;
  fail(
      {ErrorCode::kTimeout,
       fmt::format("{} {} s", is_serving ? "nothing came for" : "no hello within", limit.count())});
}

std::string Connection::name() const {
  return (robot_id_.empty() ? "-" : robot_id_) + " " + to_text(peer_);
}

}  // namespace orbbuf
