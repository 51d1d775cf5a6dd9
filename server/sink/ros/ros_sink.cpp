// SPDX-License-Identifier: Apache-2.0
#include "server/sink/ros/ros_sink.hpp"

#include <spdlog/spdlog.h>

#include <atomic>
#include <boost/asio/post.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <cstddef>
#include <future>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include "common/log.hpp"
#include "server/calibration/camera_info.hpp"
#include "server/sink/losses.hpp"
#include "server/sink/ros/ros_node.hpp"
#include "server/sink/ros_name.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;

constexpr std::size_t kMostWaitingBytes = std::size_t{64} << 20U;
constexpr std::chrono::seconds kFarewell{1};

/// The node and the thread it lives on.
struct Ros {
  Ros() {
    asio::post(thread, [] { name_this_thread("ros"); });
  }

  RosNode node;                               // used on `ros` only
  std::atomic<std::size_t> waiting_bytes{0};  // of the frames that `ros` has not come to
  asio::thread_pool thread{1};
};

/// Never destroyed: roscpp's own statics are younger, so they would be gone by then.
Ros& the_ros() {
  static Ros& ros = *std::make_unique<Ros>().release();
  return ros;
}

class RosSink final : public FrameSink {
 public:
  RosSink(asio::io_context& main, const SessionInfo& info, std::string_view frame_id)
      : main_(main), source_(std::make_shared<Source>(info, frame_id)) {}

  void async_write(FramePtr frame, Done done) override {
    Ros& ros = the_ros();
    const std::size_t bytes = frame->jpeg.size();
    if (ros.waiting_bytes + bytes <= kMostWaitingBytes) {
      ros.waiting_bytes += bytes;
      asio::post(ros.thread, [&ros, bytes, source = source_, frame = std::move(frame)] {
        publish(ros.node, *source, *frame);
        ros.waiting_bytes -= bytes;
      });
    } else {
      source_->losses.add("64 MiB of frames wait for the master");
    }
    asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
  }

  void async_write_drops(wire::Dropped /*dropped*/, Done done) override {
    asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
  }

  std::uint64_t lost() const override { return source_->losses.count(); }

 private:
  struct Source {
    Source(const SessionInfo& info, std::string_view frame_pattern)
        : session(info.robot_id + " " + info.session_id),
          topic("/" + ros_name(info.robot_id)),
          frame_id(ros_frame_id(frame_pattern, ros_name(info.robot_id))),
          cameras(calibrated_cameras(info.calibration, session + ": published")),
          losses(session + ": ros") {}

    const std::string session;
    const std::string topic;
    const std::string frame_id;
    const CalibratedCameras cameras;
    bool is_stereo = false;  // `ros` only
    Losses losses;
  };

  static void publish(RosNode& node, Source& source, const EncodedFrame& frame) {
    if (!node.is_connected()) return source.losses.add("no master");
    if (frame.is_stereo() && !std::exchange(source.is_stereo, true)) {
      warn_without_baseline(source.cameras, source.session);
    }
    const auto image = [&](const std::string& base, std::span<const std::uint8_t> jpeg,
                           const std::optional<CameraInfo>& camera) {
      node.publish(base, source.frame_id, frame.capture_time_ns, jpeg.data(), jpeg.size(),
                   camera ? &*camera : nullptr);
    };
    const auto& cameras = source.cameras;
    image(frame.is_stereo() ? source.topic + "/left" : source.topic, frame.left(), cameras.left);
    if (frame.is_stereo()) image(source.topic + "/right", frame.right(), cameras.right);
  }

  asio::io_context& main_;
  const std::shared_ptr<Source> source_;  // shared with what waits on `ros`
};

}  // namespace

std::shared_ptr<FrameSink> make_ros_sink(asio::io_context& main, const SessionInfo& info,
                                         std::string_view frame_id) {
  return std::make_shared<RosSink>(main, info, frame_id);
}

bool end_ros() {
  const auto ended = std::make_shared<std::promise<void>>();
  asio::post(the_ros().thread, [ended] {
    the_ros().node.close();
    ended->set_value();
  });
  return ended->get_future().wait_for(kFarewell) == std::future_status::ready;
}

}  // namespace orbbuf
