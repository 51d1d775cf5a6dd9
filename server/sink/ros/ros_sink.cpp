// SPDX-License-Identifier: Apache-2.0
#include "server/sink/ros/ros_sink.hpp"

#include <algorithm>
#include <chrono>
#include <future>
#include <optional>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "common/calibration/camera_info.hpp"
#include "common/jpeg.hpp"
#include "common/log.hpp"
#include "common/ros_name.hpp"
#include "server/sink/paced_sink.hpp"
#include "server/sink/ros/ros_node.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;

constexpr std::chrono::milliseconds kLookForSubscriber{50};
constexpr std::chrono::seconds kFarewell{1};

/// The node and the thread it lives on.
struct Ros {
  RosNode node;  // this and the following: used on `ros` only, and by end_ros() when that has ended
  JpegCodec codec{"ros"};
  PacedThreads threads{"ros"};
};

/// Never destroyed: roscpp's own statics are younger, so they would be gone by then.
Ros& the_ros() {
  static Ros& ros = *std::make_unique<Ros>().release();
  return ros;
}

class RosSession final : public PacedSession {
 public:
  RosSession(const SessionInfo& info, const RosSettings& settings)
      : PacedSession(the_ros().threads, info, "ros", Pace(settings.pace)),
        settings_(settings),
        topic_("/" + ros_name(info.robot_id)),
        frame_id_(ros_frame_id(settings.frame_id, ros_name(info.robot_id))),
        cameras_(calibrated_cameras(info.calibration, session_ + ": published")) {}

 private:
  struct Image {
    std::string base;  // of its topics
    std::span<const std::uint8_t> jpeg;
    const std::optional<CameraInfo>& camera;
    GrayImage gray;  // empty: not decoded
  };

  std::optional<Clock::time_point> wait_for_readers() override {
    if (is_begun_) return std::nullopt;
    const auto now = Clock::now();
    if (!last_look_) last_look_ = now + settings_.wait_for_subscriber;
    const EncodedFrame* const first = first_frame();
    const bool is_awaited = first == nullptr || !has_subscribers(*first);
    if (is_awaited && now < *last_look_) return std::min(now + kLookForSubscriber, *last_look_);
    is_begun_ = true;
    if (is_awaited) log_info("{}: ros: publishing without a subscriber", session_);
    return std::nullopt;
  }

  bool has_subscribers(const EncodedFrame& frame) const {
    RosNode& node = the_ros().node;
    if (!node.is_connected()) return false;
    for (const wire::StreamDeclaration& stream : streams_) {
      if (stream.codec == wire::kSampleCodec) node.advertise_imu(topic_of(stream));
    }
    return std::ranges::all_of(images(frame), [&](const Image& image) {
      node.advertise(image.base, settings_.queue);
      return node.has_image_subscriber(image.base);
    });
  }

  std::vector<Image> images(const EncodedFrame& frame) const {
    if (!frame.is_stereo()) return {{topic_, frame.left(), cameras_.left, {}}};
    return {{topic_ + "/left", frame.left(), cameras_.left, {}},
            {topic_ + "/right", frame.right(), cameras_.right, {}}};
  }

  std::optional<Error> publish(const EncodedFrame& frame) override {
    RosNode& node = the_ros().node;
    if (!node.is_connected()) return Error{"no master"};
    if (frame.is_stereo() && !std::exchange(is_stereo_, true)) {
      warn_without_right_camera(cameras_, session_);
    }
    auto pair = images(frame);
    for (const Image& image : pair) node.advertise(image.base, settings_.queue);
    std::string problem = decode(pair);
    for (const Image& image : pair) {
      const bool is_decoded = !image.gray.pixels.empty();
      const RosImage message{frame.capture_time_ns,
                             image.jpeg.data(),
                             image.jpeg.size(),
                             is_decoded ? image.gray.pixels.data() : nullptr,
                             static_cast<std::uint32_t>(image.gray.width_px),
                             static_cast<std::uint32_t>(image.gray.height_px),
                             image.camera ? &*image.camera : nullptr};
      if (!node.publish(image.base, frame_id_, message)) {
        problem = "a subscriber of " + image.base + " is slow, and ros.queue messages wait for it";
      }
    }
    return problem.empty() ? std::nullopt : std::optional(Error{problem});
  }

  std::string topic_of(const wire::StreamDeclaration& stream) const {
    return topic_ + "/" + ros_name(stream.name);
  }

  std::optional<Error> publish(const wire::StreamDeclaration& stream,
                               const Sample& sample) override {
    if (stream.codec != wire::kSampleCodec) return std::nullopt;
    RosNode& node = the_ros().node;
    if (!node.is_connected()) return Error{"no master"};
    const std::string topic = topic_of(stream);
    const RosImu imu{sample.time_ns, sample.angular_velocity, sample.linear_acceleration};
    if (node.publish(topic, frame_id_, imu)) return std::nullopt;
    return Error{"a subscriber of " + topic + " is slow"};
  }

  /// Those that have a subscriber. If one cannot be decoded then none is, and the reason returned.
  static std::string decode(std::vector<Image>& images) {
    for (Image& image : images) {
      if (!the_ros().node.has_raw_subscriber(image.base)) continue;
      auto gray = the_ros().codec.decode_gray(image.jpeg, 1);
      if (!gray) {
        for (Image& each : images) each.gray = {};
        return image.base + "/image_raw: " + gray.error().text;
      }
      image.gray = std::move(gray).value();
    }
    return "";
  }

  const RosSettings settings_;
  const std::string topic_;
  const std::string frame_id_;
  const CalibratedCameras cameras_;
  std::optional<Clock::time_point> last_look_;  // for the first subscriber
  bool is_begun_ = false;                       // nothing waits for subscribers any more
  bool is_stereo_ = false;
};

}  // namespace

std::shared_ptr<FrameSink> make_ros_sink(asio::io_context& main, const SessionInfo& info,
                                         const RosSettings& settings) {
  return std::make_shared<PacedSink>(main, the_ros().threads,
                                     std::make_shared<RosSession>(info, settings));
}

bool end_ros() {
  const auto ended = std::make_shared<std::promise<void>>();
  the_ros().threads.finish(Pace::Clock::time_point::min());
  std::thread([ended] {
    Ros& ros = the_ros();
    ros.threads.pool.join();
    ros.node.close();
    ended->set_value();
  }).detach();
  return ended->get_future().wait_for(kFarewell) == std::future_status::ready;
}

}  // namespace orbbuf
