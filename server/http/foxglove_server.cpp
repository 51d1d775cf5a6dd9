// SPDX-License-Identifier: Apache-2.0
#include "server/http/foxglove_server.hpp"

#include <algorithm>
#include <boost/asio/buffer.hpp>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/core/buffers_to_string.hpp>
#include <boost/beast/core/flat_buffer.hpp>
#include <boost/beast/http/empty_body.hpp>
#include <boost/beast/http/field.hpp>
#include <boost/beast/http/message.hpp>
#include <boost/beast/http/rfc7230.hpp>
#include <boost/beast/websocket.hpp>
#include <boost/beast/websocket/stream.hpp>
#include <chrono>
#include <utility>
#include <variant>

#include "common/as_bytes.hpp"
#include "common/keep_alive.hpp"
#include "common/log.hpp"
#include "server/foxglove/messages.hpp"
#include "server/http/views.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
namespace websocket = boost::beast::websocket;
using boost::beast::http::field;
using boost::system::error_code;

/// Newer programs ask for the second.
constexpr std::array<std::string_view, 2> kSubprotocols = {"foxglove.websocket.v1",
                                                           "foxglove.sdk.v1"};
constexpr unsigned kBadRequest = 400;
constexpr unsigned kForbidden = 403;
constexpr std::string_view kFoxglovesPage = "https://app.foxglove.dev";

/// As the server calls it; empty: none of ours is offered.
std::string_view subprotocol_of(const UpgradeRequest& request) {
  boost::beast::http::token_list offered(request[field::sec_websocket_protocol]);
  for (const std::string_view name : kSubprotocols) {
    if (offered.exists({name.data(), name.size()})) return name;
  }
  return {};
}

/// Any page that a browser shows may open a WebSocket to any server, and says where it is from. A
/// program that is no browser says nothing, or has an origin that no page can have. `host`: of the
/// request.
bool is_trusted_origin(std::string_view origin, const std::string& host) {
  if (origin.empty() || origin == kFoxglovesPage) return true;
  for (const std::string_view scheme : {"http://", "https://"}) {
    if (origin.starts_with(scheme)) {
      return is_own_page(std::string(origin.substr(scheme.size())), host);
    }
  }
  return origin != "null";
}

std::string_view suffix(int topic) {
  constexpr std::array<std::string_view, 8> kSuffixes = {
      "/image",       "/calibration",       "/left/image", "/left/calibration",
      "/right/image", "/right/calibration", "/drops",      "/status"};
  return kSuffixes.at(static_cast<std::size_t>(topic));
}

std::uint64_t log_time(std::int64_t time_ns) {
  return static_cast<std::uint64_t>(std::max<std::int64_t>(time_ns, 0));
}

std::vector<std::uint8_t> as_payload(const std::string& text) { return {text.begin(), text.end()}; }

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

/// One program's connection that shows what robots send, by Foxglove's WebSocket protocol. Its
/// messages wait in a queue of its own; those that have waited for kMostAge, or are more than
/// kMostBytes, are given up, the oldest first. The viewer is told how many. Thread-bound to `main`.
/// Lives in a shared_ptr, held by its owner and its operations.
class FoxgloveServer::Viewer final : public std::enable_shared_from_this<Viewer> {
 public:
  using Clock = std::chrono::steady_clock;

  static constexpr std::chrono::seconds kMostAge{1};
  static constexpr std::size_t kMostBytes = std::size_t{16} << 20;
  static constexpr std::size_t kMostTextBytes = std::size_t{4} << 20;  ///< that wait; or it is cut
  static constexpr std::size_t kMostSubscriptions = 4096;
  static constexpr std::chrono::seconds kWriteTime{10};  ///< to take a message

  /// The stream's handshake under TLS is done. `owner` must outlive every run of the io_context.
  Viewer(std::unique_ptr<Stream> stream, FoxgloveServer& owner)
      : stream_(std::move(stream)),
        socket_(*stream_),
        owner_(owner),
        timer_(stream_->get_executor()) {}

  /// Answers the request, which asked for `subprotocol` among others.
  void start(std::shared_ptr<const UpgradeRequest> request, std::string_view subprotocol) {
    socket_.set_option(websocket::stream_base::decorator(
        [name = std::string(subprotocol)](websocket::response_type& response) {
          response.set(field::sec_websocket_protocol, name);
          response.set(field::server, "orbbuf-server");
        }));
    // One that shows nothing is noticed by this only.
    keep_alive(stream_->socket().native_handle());
    socket_.auto_fragment(false);
    socket_.read_message_max(kMostRequestBytes);
    limit();
    const auto& message = *request;
    socket_.async_accept(message, [self = shared_from_this(),
                                   request = std::move(request)](const error_code& failed) {
      if (self->is_closed_) return;
      if (failed) return self->close();
      self->timer_.cancel();
      self->is_open_ = true;
      self->owner_.on_opened(*self);
      self->read();
    });
  }

  /// At once; harmless when repeated.
  void close() {
    if (std::exchange(is_closed_, true)) return;
    const auto self = shared_from_this();  // the owner lets go of it
    timer_.cancel();
    error_code ignored;  // there is nothing to do about it
    stream_->socket().close(ignored);
    owner_.on_viewer_closed(self);
  }

  void send(std::string text) {
    if (is_closed_ || !is_open_) return;
    if (text_bytes_ >= kMostTextBytes) {
      log_warn("http: a viewer is cut off that does not read what it is told");
      return close();
    }
    text_bytes_ += text.size();
    texts_.push_back(std::move(text));
    ask_for_turn();
  }

  /// At its turn.
  void write_next() {
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

  bool is_subscribed(std::uint32_t channel_id) const { return subscribed_.contains(channel_id); }
  /// To each of its subscriptions of the channel.
  void send(std::uint32_t channel_id, std::uint64_t log_time_ns, const Payload& payload) {
    const auto channel = subscribed_.find(channel_id);
    if (channel == subscribed_.end() || is_closed_) return;
    for (const std::uint32_t id : channel->second) {
      messages_.push_back({foxglove::message_head(id, log_time_ns), payload, Clock::now()});
      bytes_ += payload->size();
    }
    make_room();
    ask_for_turn();
  }

  void forget(std::uint32_t channel_id) { subscribed_.erase(channel_id); }

 private:
  static constexpr std::chrono::seconds kTellEvery{1};

  struct Message {
    std::array<std::uint8_t, foxglove::kMessageHeadBytes> head;
    Payload payload;
    Clock::time_point since;
  };

  void read() {
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

  void on_request(std::string_view text) {
    std::visit([this](const auto& request) { follow(request); }, foxglove::parse_request(text));
  }

  void follow(const foxglove::Subscribe& subscribe) {
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

  void follow(const foxglove::Unsubscribe& unsubscribe) {
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

  void follow(const foxglove::NotUnderstood& why) {
    send(foxglove::status(foxglove::StatusLevel::kError, why, "request"));
  }

  /// The newest message stays, whatever its size.
  void make_room() {
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

  void ask_for_turn() {
    if (is_writing_ || !is_open_ || std::exchange(awaits_turn_, true)) return;
    owner_.await_turn(shared_from_this());
  }

  void on_written(const error_code& failed) {
    is_writing_ = false;
    if (is_closed_) return;
    if (failed) return close();
    timer_.cancel();
    make_room();
    ask_for_turn();
  }

  void limit() {
    timer_.expires_after(kWriteTime);
    timer_.async_wait([weak = weak_from_this()](const error_code& failed) {
      const auto self = weak.lock();
      if (failed || !self || self->timer_.expiry() > Clock::now()) return;
      if (!self->is_open_ || self->is_writing_) self->close();
    });
  }

  std::unique_ptr<Stream> stream_;
  boost::beast::websocket::stream<Stream&> socket_;
  FoxgloveServer& owner_;
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

std::optional<HttpResponse> FoxgloveServer::refusal_of(const HttpRequest& request) const {
  if (request.path != "/") return error_response(kNotFound, "WebSocket is at /");
  if (subprotocol_of(*request.upgrade).empty()) {
    return error_response(kBadRequest,
                          "the WebSocket here is Foxglove's: foxglove.websocket.v1 or "
                          "foxglove.sdk.v1");
  }
  const auto origin = (*request.upgrade)[field::origin];
  if (!is_trusted_origin({origin.data(), origin.size()}, request.host)) {
    return error_response(kForbidden, "pages of this origin may not look at robots");
  }
  if (viewers_.size() < kMaxViewers) return std::nullopt;
  return error_response(kUnavailable, "as many viewers as there may be are connected");
}

void FoxgloveServer::accept(std::unique_ptr<Stream> stream, const HttpRequest& request) {
  auto viewer = std::make_shared<Viewer>(std::move(stream), *this);
  viewers_.insert(viewer);
  metrics_.viewers().open = viewers_.size();
  viewer->start(request.upgrade, subprotocol_of(*request.upgrade));
}

void FoxgloveServer::stop() {
  const auto viewers = viewers_;  // a viewer that closes leaves the original
  for (const auto& viewer : viewers) viewer->close();
}

void FoxgloveServer::on_begun(const RobotMetrics& robot) {
  forget_robots_that_are_gone();
  const std::string& id = robot.info().robot_id;
  Robot& known = robots_[id];
  known.is_described = false;
  known.cameras = calibrated_cameras(robot.info().calibration);
  for (const std::uint32_t channel : known.channels) latched_.erase(channel);
  add_channel(id, known, kDrops);
  add_channel(id, known, kStatus);
}

void FoxgloveServer::forget_robots_that_are_gone() {
  std::vector<std::uint32_t> gone;
  std::erase_if(robots_, [&](const auto& entry) {
    if (metrics_.robots().contains(entry.first)) return false;
    for (const std::uint32_t channel : entry.second.channels) {
      if (channel != 0) gone.push_back(channel);
    }
    return true;
  });
  if (gone.empty()) return;
  for (const std::uint32_t channel : gone) {
    channels_.erase(channel);
    latched_.erase(channel);
    for (const auto& viewer : viewers_) viewer->forget(channel);
  }
  tell_all(foxglove::unadvertise(gone));
}

void FoxgloveServer::on_frame(const RobotMetrics& robot, const EncodedFrame& frame) {
  const auto entry = robots_.find(robot.info().robot_id);
  if (entry == robots_.end()) return;  // its session began before this server did
  const std::string& id = entry->first;
  Robot& known = entry->second;
  if (!std::exchange(known.is_described, true)) describe(robot, known, frame);
  if (viewers_.empty()) return;
  const std::uint64_t time = log_time(frame.capture_time_ns);
  const auto publish_image = [&](Topic topic, std::string_view side,
                                 std::span<const std::uint8_t> jpeg) {
    publish(known.channels[topic], time, [&] {
      return foxglove::compressed_image(frame.capture_time_ns, id + std::string(side), jpeg);
    });
  };
  if (!frame.is_stereo()) return publish_image(kImage, "", frame.left());
  publish_image(kLeftImage, "/left", frame.left());
  publish_image(kRightImage, "/right", frame.right());
}

/// With the session's first frame it is known whether it is stereo.
void FoxgloveServer::describe(const RobotMetrics& robot, Robot& known, const EncodedFrame& frame) {
  const std::string& id = robot.info().robot_id;
  const std::uint64_t time = log_time(frame.capture_time_ns);
  const auto calibrate = [&](Topic topic, std::string_view side,
                             const std::optional<CameraInfo>& camera) {
    if (!camera) return;
    add_channel(id, known, topic);
    latch(known.channels[topic], time,
          foxglove::camera_calibration(frame.capture_time_ns, id + std::string(side), *camera));
  };
  if (!frame.is_stereo()) {
    add_channel(id, known, kImage);
    return calibrate(kCalibration, "", known.cameras.left);
  }
  add_channel(id, known, kLeftImage);
  add_channel(id, known, kRightImage);
  calibrate(kLeftCalibration, "/left", known.cameras.left);
  calibrate(kRightCalibration, "/right", known.cameras.right);
}

void FoxgloveServer::on_drops(const RobotMetrics& robot, std::span<const DropRecord> records) {
  const auto known = robots_.find(robot.info().robot_id);
  if (viewers_.empty() || known == robots_.end()) return;
  for (const DropRecord& record : records) {
    publish(known->second.channels[kDrops], log_time(record.capture_time_ns),
            [&] { return as_payload(foxglove::drop_json(record)); });
  }
}

void FoxgloveServer::on_state(const RobotMetrics& robot) {
  const auto known = robots_.find(robot.info().robot_id);
  if (viewers_.empty() || known == robots_.end()) return;
  const auto now = RobotMetrics::Clock::now();
  publish(known->second.channels[kStatus], log_time(robot.timeline().robot_time(now).count()),
          [&] { return as_payload(to_json(robot, now)); });
}

/// Once for a robot: its sessions share the channels.
void FoxgloveServer::add_channel(const std::string& robot_id, Robot& known, Topic topic) {
  if (known.channels[topic] != 0) return;
  const std::uint32_t id = known.channels[topic] = ++last_channel_;
  foxglove::LiveChannel channel{id, "/" + robot_id + std::string(suffix(topic)), "json", {}, {}};
  if (topic == kDrops) {
    channel.schema_name = foxglove::kDropSchemaName;
    channel.schema = foxglove::kDropSchema;
  } else if (topic == kStatus) {
    channel.schema_name = kRobotSchemaName;
    channel.schema = robot_schema();
  } else {
    const bool is_image = topic == kImage || topic == kLeftImage || topic == kRightImage;
    const auto schema =
        is_image ? foxglove::compressed_image_schema() : foxglove::camera_calibration_schema();
    channel.encoding = "protobuf";
    channel.schema_name = schema.name;
    channel.schema.assign(schema.descriptors.begin(), schema.descriptors.end());
  }
  tell_all(foxglove::advertise(std::span(&channel, 1)));
  channels_.emplace(id, std::move(channel));
}

void FoxgloveServer::latch(std::uint32_t channel_id, std::uint64_t time_ns,
                           std::vector<std::uint8_t> payload) {
  Latched& latched = latched_[channel_id];
  latched = {time_ns, std::make_shared<const std::vector<std::uint8_t>>(std::move(payload))};
  const auto viewers = viewers_;  // as in stop()
  for (const auto& viewer : viewers) viewer->send(channel_id, time_ns, latched.payload);
}

void FoxgloveServer::publish(std::uint32_t channel_id, std::uint64_t time_ns,
                             const Encode& encode) {
  Payload payload;
  const auto viewers = viewers_;  // as in stop()
  for (const auto& viewer : viewers) {
    if (!viewer->is_subscribed(channel_id)) continue;
    if (!payload) payload = std::make_shared<const std::vector<std::uint8_t>>(encode());
    viewer->send(channel_id, time_ns, payload);
  }
}

void FoxgloveServer::tell_all(const std::string& text) {
  const auto viewers = viewers_;  // as in stop()
  for (const auto& viewer : viewers) viewer->send(text);
}

void FoxgloveServer::on_opened(Viewer& viewer) {
  viewer.send(foxglove::server_info());
  std::vector<foxglove::LiveChannel> channels;
  for (const auto& [id, channel] : channels_) channels.push_back(channel);
  if (!channels.empty()) viewer.send(foxglove::advertise(channels));
}

bool FoxgloveServer::on_subscribed(Viewer& viewer, std::uint32_t channel_id) {
  if (!channels_.contains(channel_id)) return false;
  const auto latched = latched_.find(channel_id);
  if (latched != latched_.end()) {
    viewer.send(channel_id, latched->second.time_ns, latched->second.payload);
  }
  return true;
}

void FoxgloveServer::await_turn(const std::shared_ptr<Viewer>& viewer) {
  turns_.push_back(viewer);
  if (turns_.size() == 1) give_turn();
}

void FoxgloveServer::give_turn() {
  asio::post(main_, [this] {
    const auto viewer = std::move(turns_.front());
    turns_.pop_front();
    if (!turns_.empty()) give_turn();
    viewer->write_next();
  });
}

void FoxgloveServer::on_viewer_closed(const std::shared_ptr<Viewer>& viewer) {
  viewers_.erase(viewer);
  metrics_.viewers().open = viewers_.size();
}

}  // namespace orbbuf
