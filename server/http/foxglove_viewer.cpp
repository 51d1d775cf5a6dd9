// SPDX-License-Identifier: Apache-2.0
#include "server/http/foxglove_viewer.hpp"

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/websocket.hpp>
#include <utility>
#include <variant>

#include "common/keep_alive.hpp"
#include "common/log.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
namespace websocket = boost::beast::websocket;
using boost::system::error_code;

}  // namespace

/// How Beast ends a connection of ours: the viewer's close frame has been answered, or time is
/// over.
void beast_close_socket(Stream& stream) {
  error_code ignored;  // there is nothing to do about it
  stream.socket().close(ignored);
}
template <class Handler>
void async_teardown(boost::beast::role_type /*role*/, Stream& stream, Handler&& handler) {
  beast_close_socket(stream);
  asio::post(stream.get_executor(),
             [handler = std::forward<Handler>(handler)]() mutable { handler(error_code()); });
}

FoxgloveViewer::FoxgloveViewer(std::unique_ptr<Stream> stream, FoxgloveOwner& owner)
    : stream_(std::move(stream)),
      socket_(*stream_),
      owner_(owner),
      timer_(stream_->get_executor()) {}

void FoxgloveViewer::start(std::shared_ptr<const UpgradeRequest> request,
                           std::string_view subprotocol) {
  socket_.set_option(websocket::stream_base::decorator(
      [name = std::string(subprotocol)](websocket::response_type& response) {
        response.set(boost::beast::http::field::sec_websocket_protocol, name);
        response.set(boost::beast::http::field::server, "orbbuf-server");
      }));
  keep_alive(stream_->socket().native_handle());  // one that shows nothing is noticed by this only
  socket_.auto_fragment(false);
  socket_.read_message_max(kMostRequestBytes);
  limit();
  const auto& message = *request;
  socket_.async_accept(
      message, [self = shared_from_this(), request = std::move(request)](const error_code& failed) {
        if (self->is_closed_) return;
        if (failed) return self->close();
        self->timer_.cancel();
        self->is_open_ = true;
        self->owner_.on_opened(*self);
        self->read();
      });
}

void FoxgloveViewer::read() {
  socket_.async_read(in_, [self = shared_from_this()](const error_code& failed, std::size_t) {
    if (self->is_closed_) return;
    if (failed) return self->close();  // gone, or against the rules of WebSocket
    if (self->socket_.got_text()) {
      self->on_request(boost::beast::buffers_to_string(self->in_.data()));
    } else {
      self->follow(foxglove::NotUnderstood("this server only publishes: it takes no messages"));
    }
    self->in_.clear();
    if (!self->is_closed_) self->read();
  });
}

void FoxgloveViewer::on_request(std::string_view text) {
  std::visit([this](const auto& request) { follow(request); }, foxglove::parse_request(text));
}

void FoxgloveViewer::follow(const foxglove::Subscribe& subscribe) {
  for (const auto& [id, channel] : subscribe) {
    if (channels_.contains(id)) {
      follow("subscription " + std::to_string(id) + " exists already");
    } else if (channels_.size() >= kMostSubscriptions) {
      follow("more than " + std::to_string(kMostSubscriptions) + " subscriptions");
    } else {
      channels_[id] = channel;
      subscribed_[channel].push_back(id);
      if (owner_.on_subscribed(*this, channel)) continue;
      follow(foxglove::Unsubscribe{id});
      follow("there is no channel " + std::to_string(channel));
    }
  }
}

void FoxgloveViewer::follow(const foxglove::Unsubscribe& unsubscribe) {
  for (const std::uint32_t id : unsubscribe) {
    const auto entry = channels_.find(id);
    if (entry == channels_.end()) {
      follow("there is no subscription " + std::to_string(id));
      continue;
    }
    const auto channel = subscribed_.find(entry->second);
    if (channel != subscribed_.end()) {
      std::erase(channel->second, id);
      if (channel->second.empty()) subscribed_.erase(channel);
    }
    channels_.erase(entry);
  }
}

void FoxgloveViewer::follow(const foxglove::NotUnderstood& why) {
  send(foxglove::status(foxglove::StatusLevel::kError, why, "request"));
}

void FoxgloveViewer::send(std::string text) {
  if (is_closed_ || !is_open_) return;
  if (text_bytes_ >= kMostTextBytes) {
    log_warn("http: a viewer is cut off that does not read what it is told");
    return close();
  }
  text_bytes_ += text.size();
  texts_.push_back(std::move(text));
  ask_for_turn();
}

void FoxgloveViewer::send(std::uint32_t channel_id, std::uint64_t log_time_ns,
                          const Payload& payload) {
  const auto channel = subscribed_.find(channel_id);
  if (channel == subscribed_.end() || is_closed_) return;
  for (const std::uint32_t id : channel->second) {
    messages_.push_back({foxglove::message_head(id, log_time_ns), payload, Clock::now()});
    bytes_ += payload->size();
  }
  make_room();
  ask_for_turn();
}

void FoxgloveViewer::ask_for_turn() {
  if (is_writing_ || !is_open_ || std::exchange(awaits_turn_, true)) return;
  owner_.await_turn(shared_from_this());
}

/// The newest message stays, whatever its size.
void FoxgloveViewer::make_room() {
  const auto now = Clock::now();
  std::uint64_t count = 0;
  while (messages_.size() > 1 &&
         (bytes_ > kMostBytes || messages_.front().since + kMostAge < now)) {
    bytes_ -= messages_.front().payload->size();
    messages_.pop_front();
    ++count;
  }
  if (count == 0) return;
  given_up_ += count;
  owner_.on_given_up(count);
}

void FoxgloveViewer::write_next() {
  awaits_turn_ = false;
  if (is_writing_ || is_closed_ || !is_open_) return;
  if (given_up_ > told_given_up_ && Clock::now() >= told_at_ + kTellEvery) {
    told_given_up_ = given_up_;
    told_at_ = Clock::now();
    std::string text = foxglove::status(
        foxglove::StatusLevel::kWarning,
        fmt::format(
            "{} messages were not shown: the connection or this program is too slow for them",
            given_up_),
        "given up");
    text_bytes_ += text.size();
    texts_.push_back(std::move(text));
  }
  if (texts_.empty() && messages_.empty()) return;
  is_writing_ = true;
  limit();
  const auto done = [self = shared_from_this()](const error_code& failed, std::size_t) {
    self->on_written(failed);
  };
  if (!texts_.empty()) {
    text_ = std::move(texts_.front());
    texts_.pop_front();
    text_bytes_ -= text_.size();
    socket_.text(true);
    return socket_.async_write(asio::buffer(text_), done);
  }
  message_ = std::move(messages_.front());
  messages_.pop_front();
  bytes_ -= message_.payload->size();
  socket_.binary(true);
  socket_.async_write(std::array<asio::const_buffer, 2>{asio::buffer(message_.head),
                                                        asio::buffer(*message_.payload)},
                      done);
}

void FoxgloveViewer::on_written(const error_code& failed) {
  is_writing_ = false;
  if (is_closed_) return;
  if (failed) return close();
  timer_.cancel();
  make_room();
  ask_for_turn();
}

void FoxgloveViewer::close() {
  if (std::exchange(is_closed_, true)) return;
  const auto self = shared_from_this();  // the owner lets go of it
  timer_.cancel();
  error_code ignored;  // there is nothing to do about it
  stream_->socket().close(ignored);
  owner_.on_viewer_closed(self);
}

void FoxgloveViewer::limit() {
  timer_.expires_after(kWriteTime);
  timer_.async_wait([weak = weak_from_this()](const error_code& failed) {
    const auto self = weak.lock();
    if (failed || !self || self->timer_.expiry() > Clock::now()) return;
    self->close();
  });
}

}  // namespace orbbuf
