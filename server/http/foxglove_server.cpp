// SPDX-License-Identifier: Apache-2.0
#include "server/http/foxglove_server.hpp"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <boost/beast/http/field.hpp>
#include <boost/beast/http/rfc7230.hpp>
#include <utility>

#include "common/as_bytes.hpp"
#include "server/foxglove/messages.hpp"
#include "server/http/views.hpp"

namespace orbbuf {
namespace {

using boost::beast::http::field;

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
  auto viewer =
      std::make_shared<FoxgloveViewer>(std::move(stream), static_cast<FoxgloveOwner&>(*this));
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
  FoxgloveViewer::Payload payload;
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

void FoxgloveServer::on_opened(FoxgloveViewer& viewer) {
  viewer.send(foxglove::server_info());
  std::vector<foxglove::LiveChannel> channels;
  for (const auto& [id, channel] : channels_) channels.push_back(channel);
  if (!channels.empty()) viewer.send(foxglove::advertise(channels));
}

bool FoxgloveServer::on_subscribed(FoxgloveViewer& viewer, std::uint32_t channel_id) {
  if (!channels_.contains(channel_id)) return false;
  const auto latched = latched_.find(channel_id);
  if (latched != latched_.end()) {
    viewer.send(channel_id, latched->second.time_ns, latched->second.payload);
  }
  return true;
}

void FoxgloveServer::await_turn(const std::shared_ptr<FoxgloveViewer>& viewer) {
  turns_.push_back(viewer);
  if (turns_.size() == 1) give_turn();
}

void FoxgloveServer::give_turn() {
  boost::asio::post(main_, [this] {
    const auto viewer = std::move(turns_.front());
    turns_.pop_front();
    if (!turns_.empty()) give_turn();
    viewer->write_next();
  });
}

void FoxgloveServer::on_viewer_closed(const std::shared_ptr<FoxgloveViewer>& viewer) {
  viewers_.erase(viewer);
  metrics_.viewers().open = viewers_.size();
}

}  // namespace orbbuf
