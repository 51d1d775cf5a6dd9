// SPDX-License-Identifier: Apache-2.0
#include "server/sink/ros_sink.hpp"

#include <algorithm>
#include <atomic>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <cctype>
#include <chrono>
#include <future>
#include <optional>
#include <utility>

#include "common/log.hpp"
#include "server/dataset/calibration.hpp"
#include "server/dataset/camera_info.hpp"
#include "server/sink/ros_node.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;

constexpr int kMostWaiting = 100;  // frames of a session, as many as roscpp itself keeps of a topic
constexpr std::chrono::seconds kFarewell{1};

/// A robot's id as the first part of a topic's name.
std::string topic_of(const std::string& robot_id) {
  const bool is_letter_first = std::isalpha(static_cast<unsigned char>(robot_id.front())) != 0;
  std::string name = is_letter_first ? robot_id : "ros_" + robot_id;
  std::ranges::replace_if(
      name, [](unsigned char c) { return std::isalnum(c) == 0; }, '_');
  return "/" + name;
}

CalibratedCameras cameras_of(const SessionInfo& info) {
  const auto parsed = parse_calibration(info.calibration);
  return parsed ? calibrated_cameras(parsed.value()) : CalibratedCameras();
}

/// The node and the thread it lives on.
struct Ros {
  Ros() {
    asio::post(thread, [] { name_this_thread("ros"); });
  }

  RosNode node;  // used on `ros` only
  asio::thread_pool thread{1};
};

/// Ends with the process. roscpp waits without limit for a master that takes a connection and says
/// nothing: what still waits for one then is left to the system.
class RosForTheProcess {
 public:
  RosForTheProcess() : ros_(std::make_unique<Ros>()) {}
  ~RosForTheProcess() {
    const auto ended = std::make_shared<std::promise<void>>();
    asio::post(ros_->thread, [ros = ros_.get(), ended] {
      ros->node.close();
      ended->set_value();
    });
    if (ended->get_future().wait_for(kFarewell) == std::future_status::ready) return;
    static_cast<void>(ros_.release());
  }
  RosForTheProcess(const RosForTheProcess&) = delete;
  RosForTheProcess& operator=(const RosForTheProcess&) = delete;

  Ros& operator*() const { return *ros_; }

 private:
  std::unique_ptr<Ros> ros_;
};

Ros& the_ros() {
  static const RosForTheProcess ros;
  return *ros;
}

class RosSink final : public FrameSink {
 public:
  RosSink(asio::io_context& main, const SessionInfo& info)
      : main_(main), source_(std::make_shared<Source>(info)) {}

  void async_write(FramePtr frame, Done done) override {
    if (source_->waiting < kMostWaiting) {
      ++source_->waiting;
      asio::post(the_ros().thread, [source = source_, frame = std::move(frame)] {
        publish(*source, *frame);
        --source->waiting;
      });
    }
    asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
  }

  void async_write_drops(std::vector<DropRecord> /*records*/, Done done) override {
    asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
  }

 private:
  struct Source {
    explicit Source(const SessionInfo& info)
        : topic(topic_of(info.robot_id)), cameras(cameras_of(info)) {}

    const std::string topic;
    const CalibratedCameras cameras;
    std::atomic<int> waiting = 0;  ///< frames that `ros` has not come to
  };

  static void publish(const Source& source, const EncodedFrame& frame) {
    const auto image = [&](const std::string& base, std::span<const std::uint8_t> jpeg,
                           const std::optional<CameraInfo>& camera) {
      the_ros().node.publish(base, frame.capture_time_ns, jpeg.data(), jpeg.size(),
                             camera ? &*camera : nullptr);
    };
    const auto& [left, right] = source.cameras;
    image(frame.is_stereo() ? source.topic + "/left" : source.topic, frame.left(), left);
    if (frame.is_stereo()) image(source.topic + "/right", frame.right(), right);
  }

  asio::io_context& main_;
  const std::shared_ptr<Source> source_;  // shared with what waits on `ros`
};

}  // namespace

std::shared_ptr<FrameSink> make_ros_sink(asio::io_context& main, const SessionInfo& info) {
  return std::make_shared<RosSink>(main, info);
}

}  // namespace orbbuf
