// SPDX-License-Identifier: Apache-2.0
#include "daemon/net/server_connection.hpp"

#include <netinet/tcp.h>

#include <boost/asio/buffer.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/ssl/error.hpp>
#include <boost/asio/write.hpp>
#include <utility>

#include "common/keep_alive.hpp"
#include "daemon/net/bind_interface.hpp"

namespace orbbuf {
namespace asio = boost::asio;
using boost::system::error_code;

namespace {

/// A stalled connection's retransmissions are as large as what is lost, the attempts beside it are
/// small, and sooner.
constexpr std::chrono::seconds kLongestRetransmission{4};

}  // namespace

ServerConnection::ServerConnection(asio::io_context& io, TlsContext* tls, Owner& owner)
    : stream_(asio::ip::tcp::socket(io), tls), owner_(&owner) {}

void ServerConnection::open(const Way& way, const wire::Hello& hello, std::uint32_t unsent_limit) {
  way_ = way;
  message_ = wire::encode(hello);
  if (const auto failed = prepare_socket()) {
    return asio::post(stream_.get_executor(), [self = shared_from_this(), failed] {
      if (self->owner_) self->fail(*failed);
    });
  }
  stream_.socket().async_connect(
      way.to.endpoint, [self = shared_from_this(), unsent_limit](const error_code& error) {
        if (!self->owner_) return;
        if (error) return self->fail("cannot connect" + self->way_.over(), error);
        self->on_connected(unsent_limit);
      });
}

/// What must be set before the SYN; for the segments, so that the server's are as small.
std::optional<Error> ServerConnection::prepare_socket() {
  using MaxSegment = asio::detail::socket_option::integer<IPPROTO_TCP, TCP_MAXSEG>;
  if (way_.largest_segment == 0 && way_.interface.empty()) return std::nullopt;
  error_code failed;
  stream_.socket().open(way_.to.endpoint.protocol(), failed);
  if (failed) return Error{"cannot open a socket: " + failed.message()};
  if (way_.largest_segment > 0) {
    stream_.socket().set_option(MaxSegment(way_.largest_segment), failed);  // as well as it can
  }
  if (way_.interface.empty()) return std::nullopt;
  return bind_interface(stream_.socket().native_handle(), way_.to.endpoint.protocol().family(),
                        way_.interface);
}

void ServerConnection::on_connected(std::uint32_t unsent_limit) {
  auto& socket = stream_.socket();
  error_code error;
  socket.set_option(asio::ip::tcp::no_delay(true), error);
  if (error) return fail("cannot set TCP_NODELAY", error);
  keep_alive(socket.native_handle());  // without it a dead server is merely noticed later
  limit_retransmission_interval(socket.native_handle(), kLongestRetransmission);
  if (!limit_unsent(socket.native_handle(), unsent_limit)) {
    return fail(system_error("cannot set TCP_NOTSENT_LOWAT", errno));
  }
  owner_->on_step(*this);
  if (!owner_) return;
  if (!stream_.is_tls()) return say_hello();
  stream_.async_handshake_as_robot(way_.to.server.host,
                                   [self = shared_from_this()](const error_code& failed) {
                                     if (!self->owner_) return;
                                     if (failed) return self->fail("no TLS", failed);
                                     self->owner_->on_step(*self);
                                     if (self->owner_) self->say_hello();
                                   });
}

void ServerConnection::say_hello() {
  has_said_hello_ = true;
  asio::async_write(stream_, asio::buffer(message_),
                    [self = shared_from_this()](const error_code& failed, std::size_t) {
                      if (self->owner_ && failed) self->fail("cannot say hello", failed);
                    });
  read_header();
}

void ServerConnection::write(std::vector<std::uint8_t> message) {
  is_writable_ = false;
  message_ = std::move(message);
  asio::async_write(stream_, asio::buffer(message_),
                    [self = shared_from_this()](const error_code& error, std::size_t) {
                      self->on_written(error);
                    });
}

void ServerConnection::write(FramePtr frame) {
  is_writable_ = false;
  frame_ = std::move(frame);
  frame_head_ = wire::encode_frame_head(*frame_);
  const std::array<asio::const_buffer, 2> parts = {asio::buffer(frame_head_),
                                                   asio::buffer(frame_->jpeg)};
  asio::async_write(stream_, parts,
                    [self = shared_from_this()](const error_code& error, std::size_t) {
                      self->on_written(error);
                    });
}

void ServerConnection::on_written(const error_code& error) {
  frame_.reset();
  if (!owner_) return;
  if (error) return fail("write failed", error);
  wait_writable();
}

void ServerConnection::wait_writable() {
  stream_.socket().async_wait(asio::socket_base::wait_write,
                              [self = shared_from_this()](const error_code& error) {
                                if (!self->owner_) return;
                                if (error) return self->fail("write failed", error);
                                self->is_writable_ = true;
                                self->owner_->on_writable();
                              });
}

void ServerConnection::read_header() {
  asio::async_read(stream_, asio::buffer(header_),
                   [self = shared_from_this()](const error_code& error, std::size_t) {
                     if (!self->owner_) return;
                     if (error) return self->fail("read failed", error);
                     const auto header = wire::parse_header(self->header_, 0);
                     if (!header) return self->on_no_header(header.error());
                     self->read_body(header.value());
                   });
}

/// What has never sent a welcome is no orbbuf-server.
void ServerConnection::on_no_header(const wire::Fault& fault) {
  was_refused_ = !welcome_;
  fail({"the server sent no message of this protocol: " + fault.text});
}

void ServerConnection::read_body(const wire::Header& header) {
  body_.resize(header.body_bytes);
  asio::async_read(stream_, asio::buffer(body_),
                   [self = shared_from_this(), header](const error_code& error, std::size_t) {
                     if (!self->owner_) return;
                     if (error) return self->fail("read failed", error);
                     self->dispatch(header);
                   });
}

template <class Message>
bool ServerConnection::accept(const wire::Parsed<Message>& message) {
  if (!message) fail({"the server sent " + message.error().text});
  return message.has_value();
}

void ServerConnection::dispatch(const wire::Header& header) {
  if (header.type == wire::Type::kWelcome && !welcome_) {
    const auto welcome = wire::parse_welcome(header, body_);
    if (!accept(welcome)) return;
    const auto version = welcome.value().version;
    if (version < wire::kOldestProtocolVersion || version > wire::kProtocolVersion) {
      return refuse({"the server wants protocol version " + std::to_string(version)});
    }
    if (const auto why = owner_->refusal_of(welcome.value().position)) return refuse(*why);
    welcome_ = welcome.value();
    owner_->on_welcome(welcome.value().position);
    if (owner_) wait_writable();
  } else if (header.type == wire::Type::kAck && welcome_) {
    const auto ack = wire::parse_ack(header, body_);
    if (!accept(ack)) return;
    if (const auto why = owner_->refusal_of(ack.value().position)) return refuse(*why);
    owner_->on_ack(ack.value());
  } else if (header.type == wire::Type::kBye && welcome_) {
    const auto bye = wire::parse_bye(header, body_);
    if (!accept(bye)) return;
    owner_->on_bye(bye.value().position);
  } else if (header.type == wire::Type::kError) {
    const auto refusal = wire::parse_error(header, body_);
    if (!accept(refusal)) return;
    return on_error(refusal.value());
  } else {
    return fail({"the server sent an unexpected " + std::string(to_string(header.type))});
  }
  if (owner_) read_header();
}

void ServerConnection::on_error(const wire::ErrorMessage& error) {
  const Error why{"the server says: " + error.text};
  if (error.code == wire::ErrorCode::kReplaced || error.code == wire::ErrorCode::kTimeout) {
    return fail(why);
  }
  was_sent_away_ = welcome_ && error.code == wire::ErrorCode::kSentAway;
  was_sent_away_ ? fail(why) : refuse(why);
}

void ServerConnection::refuse(const Error& error) {
  was_refused_ = true;
  fail(error);
}

/// OpenSSL's own errors are about certificates and versions, the others about the connection.
void ServerConnection::fail(const std::string& attempt, const error_code& error) {
  was_refused_ = !welcome_ && error.category() == asio::error::get_ssl_category();
  fail({attempt + ": " + stream_.explain(error)});
}

void ServerConnection::fail(const Error& error) {
  Owner* const owner = owner_;
  close();
  owner->on_failed(*this, error);
}

void ServerConnection::close() {
  owner_ = nullptr;
  is_writable_ = false;
  error_code ignored;  // a socket that is already gone is as closed as it gets
  stream_.socket().set_option(asio::socket_base::linger(true, 0), ignored);
  stream_.socket().close(ignored);
}

}  // namespace orbbuf
