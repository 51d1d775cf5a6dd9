// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <boost/asio/io_context.hpp>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "common/calibration/camera_info.hpp"
#include "common/net/stream.hpp"
#include "server/http/foxglove_protocol.hpp"
#include "server/http/request_reader.hpp"
#include "server/http/response.hpp"
#include "server/live/metrics.hpp"

namespace orbbuf {

/// Shows what the robots send to Foxglove and other programs that speak its WebSocket protocol,
/// live and read-only. The topics are those of a recording (mcap::Recording), and /ROBOT/status,
/// the robot's figures as JSON, once a second. The last calibration is sent again to each new
/// subscriber.
///
/// Without viewers a frame costs nothing but a look. With viewers each message is made once, if any
/// has subscribed to it; it is then written to one viewer at a time, between the other work of
/// `main`, so that the robots' streams do not wait for all of them. Thread-bound to `main`.
class FoxgloveServer final : public MetricsWatcher {
 public:
  static constexpr std::size_t kMaxViewers = 64;
  static constexpr std::size_t kMostRequestBytes = std::size_t{64} << 10;  ///< of a viewer

  /// Both must outlive it.
  FoxgloveServer(boost::asio::io_context& main, Metrics& metrics)
      : main_(main), metrics_(metrics) {}

  /// The answer to a request for WebSocket (HttpRequest::upgrade) that is not accepted: the path is
  /// not `/`, it offers neither subprotocol, the page that sent it is neither this machine's nor
  /// Foxglove's own, or there are too many viewers.
  std::optional<HttpResponse> refusal_of(const HttpRequest& request) const;
  /// Requires that refusal_of() has none.
  void accept(std::unique_ptr<Stream> stream, const HttpRequest& request);
  /// Closes all connections at once.
  void stop();

  void on_begun(const RobotMetrics& robot) override;
  void on_frame(const RobotMetrics& robot, const EncodedFrame& frame) override;
  void on_drops(const RobotMetrics& robot, std::span<const DropRecord> records) override;
  void on_state(const RobotMetrics& robot) override;

 private:
  class Viewer;
  using Payload = std::shared_ptr<const std::vector<std::uint8_t>>;
  enum Topic : std::uint8_t {
    kImage,
    kCalibration,
    kLeftImage,
    kLeftCalibration,
    kRightImage,
    kRightCalibration,
    kDrops,
    kStatus,
    kTopics,
  };
  struct Robot {
    std::array<std::uint32_t, kTopics> channels{};  ///< 0: not advertised
    CalibratedCameras cameras;
    bool is_described = false;  ///< the session's images and calibrations are advertised
  };
  struct Latched {
    std::uint64_t time_ns = 0;
    Payload payload;
  };
  using Encode = std::function<std::vector<std::uint8_t>()>;

  // Called by a viewer.
  /// It is there: what it may subscribe to is to be said.
  void on_opened(Viewer& viewer);
  /// False if there is no such channel.
  bool on_subscribed(Viewer& viewer, std::uint32_t channel_id);
  /// It has something to write: write_next() is to be called from the event loop, in turn.
  void await_turn(const std::shared_ptr<Viewer>& viewer);
  /// Messages that were given up, since the viewer is too slow for them.
  void on_given_up(std::uint64_t messages) { metrics_.viewers().given_up += messages; }
  /// The last call.
  void on_viewer_closed(const std::shared_ptr<Viewer>& viewer);

  void forget_robots_that_are_gone();
  void describe(const RobotMetrics& robot, Robot& known, const EncodedFrame& frame);
  void add_channel(const std::string& robot_id, Robot& known, Topic topic);
  void latch(std::uint32_t channel_id, std::uint64_t time_ns, std::vector<std::uint8_t> payload);
  void publish(std::uint32_t channel_id, std::uint64_t time_ns, const Encode& encode);
  void tell_all(const std::string& text);
  void give_turn();

  boost::asio::io_context& main_;
  Metrics& metrics_;
  std::set<std::shared_ptr<Viewer>> viewers_;
  std::deque<std::shared_ptr<Viewer>> turns_;  // whose turn it is, next first
  std::map<std::string, Robot> robots_;
  std::map<std::uint32_t, foxglove::LiveChannel> channels_;
  std::map<std::uint32_t, Latched> latched_;  // by channel
  std::uint32_t last_channel_ = 0;
};

}  // namespace orbbuf
