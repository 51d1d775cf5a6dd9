// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <chrono>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "common/net/stream.hpp"
#include "server/http/foxglove_protocol.hpp"
#include "server/http/request_reader.hpp"

namespace orbbuf {

class FoxgloveViewer;

/// What a viewer needs from the server around it.
class FoxgloveOwner {
 public:
  /// The viewer is there: what it may subscribe to is to be said.
  virtual void on_opened(FoxgloveViewer& viewer) = 0;
  /// False if there is no such channel.
  virtual bool on_subscribed(FoxgloveViewer& viewer, std::uint32_t channel_id) = 0;
  /// It has something to write: write_next() is to be called from the event loop, in turn.
  virtual void await_turn(const std::shared_ptr<FoxgloveViewer>& viewer) = 0;
  /// Messages that were given up, since the viewer is too slow for them.
  virtual void on_given_up(std::uint64_t messages) = 0;
  /// The last call.
  virtual void on_viewer_closed(const std::shared_ptr<FoxgloveViewer>& viewer) = 0;

 protected:
  ~FoxgloveOwner() = default;
};

/// One program's connection that shows what robots send, by Foxglove's WebSocket protocol. Its
/// messages wait in a queue of its own; those that have waited for kMostAge, or are more than
/// kMostBytes, are given up, the oldest first. The viewer is told how many. Thread-bound to `main`.
/// Lives in a shared_ptr, held by its owner and its operations.
class FoxgloveViewer final : public std::enable_shared_from_this<FoxgloveViewer> {
 public:
  using Clock = std::chrono::steady_clock;
  using Payload = std::shared_ptr<const std::vector<std::uint8_t>>;

  static constexpr std::chrono::seconds kMostAge{1};
  static constexpr std::size_t kMostBytes = std::size_t{16} << 20;
  static constexpr std::size_t kMostTextBytes = std::size_t{4} << 20;  ///< that wait; or it is cut
  static constexpr std::size_t kMostSubscriptions = 4096;
  static constexpr std::size_t kMostRequestBytes = std::size_t{64} << 10;
  static constexpr std::chrono::seconds kWriteTime{10};  ///< to take a message

  /// The stream's handshake under TLS is done. `owner` must outlive every run of the io_context.
  FoxgloveViewer(std::unique_ptr<Stream> stream, FoxgloveOwner& owner);

  /// Answers the request, which asked for `subprotocol` among others.
  void start(std::shared_ptr<const UpgradeRequest> request, std::string_view subprotocol);
  /// At once; harmless when repeated.
  void close();

  void send(std::string text);
  /// At its turn.
  void write_next();
  bool is_subscribed(std::uint32_t channel_id) const { return subscribed_.contains(channel_id); }
  /// To each of its subscriptions of the channel.
  void send(std::uint32_t channel_id, std::uint64_t log_time_ns, const Payload& payload);
  void forget(std::uint32_t channel_id) { subscribed_.erase(channel_id); }

 private:
  static constexpr std::chrono::seconds kTellEvery{1};

  struct Message {
    std::array<std::uint8_t, foxglove::kMessageHeadBytes> head;
    Payload payload;
    Clock::time_point since;
  };

  void read();
  void on_request(std::string_view text);
  void follow(const foxglove::Subscribe& subscribe);
  void follow(const foxglove::Unsubscribe& unsubscribe);
  void follow(const foxglove::NotUnderstood& why);
  void make_room();
  void ask_for_turn();
  void on_written(const boost::system::error_code& failed);
  void limit();

  std::unique_ptr<Stream> stream_;
  boost::beast::websocket::stream<Stream&> socket_;
  FoxgloveOwner& owner_;
  boost::asio::steady_timer timer_;
  boost::beast::flat_buffer in_{kMostRequestBytes};
  std::map<std::uint32_t, std::uint32_t> channels_;                 // by subscription
  std::map<std::uint32_t, std::vector<std::uint32_t>> subscribed_;  // subscriptions by channel
  std::deque<std::string> texts_;
  std::size_t text_bytes_ = 0;  // of texts_
  std::deque<Message> messages_;
  std::size_t bytes_ = 0;  // of messages_
  std::string text_;       // being written, if the next is not
  Message message_{};
  std::uint64_t given_up_ = 0;
  std::uint64_t told_given_up_ = 0;
  Clock::time_point told_at_{};
  bool is_open_ = false;
  bool is_writing_ = false;
  bool awaits_turn_ = false;
  bool is_closed_ = false;
};

}  // namespace orbbuf
