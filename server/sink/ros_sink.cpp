// SPDX-License-Identifier: Apache-2.0
#include "server/sink/ros_sink.hpp"

#include <algorithm>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <cctype>
#include <optional>
#include <utility>

#include "common/log.hpp"
#include "server/dataset/calibration.hpp"
#include "server/run_in_pool.hpp"
#include "server/sink/ros_node.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;

/// A robot's id as the first part of a topic's name.
std::string topic_of(const std::string& robot_id) {
  const bool is_letter_first = std::isalpha(static_cast<unsigned char>(robot_id.front())) != 0;
  std::string name = is_letter_first ? robot_id : "ros_" + robot_id;
  std::ranges::replace_if(
      name, [](unsigned char c) { return std::isalnum(c) == 0; }, '_');
  return "/" + name;
}

/// Nothing if ROS has no name for the lens, or nobody knows where the right camera is.
std::optional<RosCamera> ros_camera(const std::string& camera_txt, bool is_right) {
  const auto parsed = parse_calibration(camera_txt);
  if (!parsed || parsed.value().model == LensModel::kFov) return std::nullopt;
  const Calibration& camera = parsed.value();
  if (is_right && camera.baseline_m <= 0) return std::nullopt;
  const bool is_fisheye = camera.model == LensModel::kEquidistant;
  const double tx = is_right ? -camera.fx_px * camera.baseline_m : 0;
  RosCamera ros;
  ros.width_px = static_cast<std::uint32_t>(camera.width_px);
  ros.height_px = static_cast<std::uint32_t>(camera.height_px);
  ros.distortion_model = is_fisheye ? "equidistant" : "plumb_bob";
  ros.distortion = camera.distortion;
  if (!is_fisheye) ros.distortion.resize(5);  // DSO has no k3, and a pinhole has none at all
  ros.k = {camera.fx_px, 0, camera.cx_px, 0, camera.fy_px, camera.cy_px, 0, 0, 1};
  ros.p = {camera.fx_px, 0, camera.cx_px, tx, 0, camera.fy_px, camera.cy_px, 0, 0, 0, 1, 0};
  return ros;
}

/// The node and the thread it lives on, for as long as the process.
struct Ros {
  Ros() : node(std::make_unique<RosNode>()) {
    asio::post(thread, [] { name_this_thread("ros"); });
  }
  ~Ros() {
    asio::post(thread, [this] { node.reset(); });
    thread.join();
  }
  Ros(const Ros&) = delete;
  Ros& operator=(const Ros&) = delete;

  std::unique_ptr<RosNode> node;  // used on `ros` only
  asio::thread_pool thread{1};
};

Ros& the_ros() {
  static Ros ros;
  return ros;
}

class RosSink final : public FrameSink {
 public:
  RosSink(asio::io_context& main, const SessionInfo& info)
      : main_(main),
        source_(std::make_shared<Source>(Source{topic_of(info.robot_id),
                                                ros_camera(info.calibration, false),
                                                ros_camera(info.calibration, true)})) {}

  void async_write(FramePtr frame, Done done) override {
    run_in_pool(
        main_, the_ros().thread,
        [source = source_, frame = std::move(frame)]() -> std::optional<Error> {
          publish(*source, *frame);
          return std::nullopt;
        },
        std::move(done));
  }

  void async_write_drops(std::vector<DropRecord> /*records*/, Done done) override {
    asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
  }

 private:
  struct Source {
    std::string topic;
    std::optional<RosCamera> left;
    std::optional<RosCamera> right;
  };

  static void publish(const Source& source, const EncodedFrame& frame) {
    const auto image = [&](const std::string& base, std::span<const std::uint8_t> jpeg,
                           const std::optional<RosCamera>& camera) {
      the_ros().node->publish(base, frame.capture_time_ns, jpeg.data(), jpeg.size(),
                              camera ? &*camera : nullptr);
    };
    image(frame.is_stereo() ? source.topic + "/left" : source.topic, frame.left(), source.left);
    if (frame.is_stereo()) image(source.topic + "/right", frame.right(), source.right);
  }

  asio::io_context& main_;
  const std::shared_ptr<const Source> source_;  // shared with the call in progress only
};

}  // namespace

std::shared_ptr<FrameSink> make_ros_sink(asio::io_context& main, const SessionInfo& info) {
  return std::make_shared<RosSink>(main, info);
}

}  // namespace orbbuf
