// SPDX-License-Identifier: Apache-2.0
#include "server/sink/ros/ros_sink.hpp"

#include <algorithm>
#include <atomic>
#include <boost/asio/post.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/asio/thread_pool.hpp>
#include <chrono>
#include <cstddef>
#include <deque>
#include <future>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "common/jpeg.hpp"
#include "common/log.hpp"
#include "common/sample.hpp"
#include "server/calibration/camera_info.hpp"
#include "server/sink/losses.hpp"
#include "server/sink/pace.hpp"
#include "server/sink/ros/ros_node.hpp"
#include "server/sink/ros_name.hpp"

namespace orbbuf {
namespace {

namespace asio = boost::asio;
using Clock = Pace::Clock;

constexpr std::size_t kMostWaitingBytes = std::size_t{64} << 20U;
constexpr std::size_t kMostPacedBytes = std::size_t{32} << 20U;
constexpr std::chrono::milliseconds kLookForSubscriber{50};
constexpr std::chrono::seconds kFarewell{1};

class Stream;

/// The node and the thread it lives on.
struct Ros {
  Ros() {
    asio::post(thread, [] { name_this_thread("ros"); });
  }

  std::atomic<std::size_t> waiting_bytes{0};  // of all frames that are not published
  RosNode node;                               // this and the following: used on `ros` only
  JpegCodec codec;
  std::set<std::shared_ptr<Stream>> busy;  // those with frames that wait
  asio::thread_pool thread{1};
};

/// Never destroyed: roscpp's own statics are younger, so they would be gone by then.
Ros& the_ros() {
  static Ros& ros = *std::make_unique<Ros>().release();
  return ros;
}

/// The frames of a session on their way to ROS. On `ros` only, but for `losses`.
class Stream : public std::enable_shared_from_this<Stream> {
 public:
  Stream(const SessionInfo& info, const RosSettings& settings)
      : losses(info.robot_id + " " + info.session_id + ": ros"),
        settings_(settings),
        session_(info.robot_id + " " + info.session_id),
        topic_("/" + ros_name(info.robot_id)),
        frame_id_(ros_frame_id(settings.frame_id, ros_name(info.robot_id))),
        cameras_(calibrated_cameras(info.calibration, session_ + ": published")),
        streams_(info.streams) {}

  /// One of the two.
  struct Message {
    FramePtr frame;
    ItemsPtr items;  // of a stream of samples

    std::size_t bytes() const { return frame ? frame->jpeg.size() : items->payload.size(); }
  };

  void add(Message message) {
    if (first_arrival_ == Clock::time_point{}) first_arrival_ = Clock::now();
    messages_.push_back(std::move(message));
    if (the_ros().busy.insert(shared_from_this()).second) publish_due();
  }

  /// Gives up what waits. The caller removes it from `busy`.
  void end() {
    for (; !messages_.empty(); pop()) losses.add("the server stops");
    timer_.cancel();
  }

  Losses losses;

 private:
  struct Image {
    std::string base;  // of its topics
    std::span<const std::uint8_t> jpeg;
    const std::optional<CameraInfo>& camera;
    GrayImage gray;  // empty: not decoded
  };

  void publish_due() {
    while (!messages_.empty()) {
      const auto& [frame, items] = messages_.front();
      const auto now = Clock::now();
      const auto due = due_time(frame.get(), now);
      if (due > now) {
        timer_.expires_at(due);
        return timer_.async_wait([self = shared_from_this()](boost::system::error_code error) {
          if (!error) self->publish_due();
        });
      }
      if (frame) {
        publish(*frame);
        pace_.published(*frame, now);
      } else {
        publish(*items);
      }
      pop();
    }
    the_ros().busy.erase(shared_from_this());
  }

  void pop() {
    the_ros().waiting_bytes -= messages_.front().bytes();
    messages_.pop_front();
  }

  /// frame: null for samples, which wait for the frames before them only.
  Clock::time_point due_time(const EncodedFrame* frame, Clock::time_point now) {
    if (!is_begun_) {
      const auto last_look = first_arrival_ + settings_.wait_for_subscriber;
      const auto first = std::ranges::find_if(
          messages_, [](const Message& each) { return each.frame != nullptr; });
      const bool is_awaited = first == messages_.end() || !has_subscribers(*first->frame);
      if (is_awaited && now < last_look) return std::min(now + kLookForSubscriber, last_look);
      is_begun_ = true;
      if (is_awaited) log_info("{}: ros: publishing without a subscriber", session_);
    }
    const bool is_paced = frame != nullptr && the_ros().waiting_bytes <= kMostPacedBytes;
    return is_paced ? pace_.due(*frame) : now;
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

  void publish(const EncodedFrame& frame) {
    RosNode& node = the_ros().node;
    if (!node.is_connected()) return losses.add("no master");
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
    if (!problem.empty()) losses.add(problem);
  }

  std::string topic_of(const wire::StreamDeclaration& stream) const {
    return topic_ + "/" + ros_name(stream.name);
  }

  void publish(const wire::Items& items) {
    RosNode& node = the_ros().node;
    const auto stream = std::ranges::find(streams_, items.stream, &wire::StreamDeclaration::id);
    const auto samples = wire::parse_samples(items.payload);
    if (stream == streams_.end() || !samples || samples.value().front().message) return;
    if (!node.is_connected()) return losses.add("no master");
    const std::string topic = topic_of(*stream);
    bool is_whole = true;
    for (const Sample& each : samples.value()) {
      const RosImu imu{each.time_ns, each.angular_velocity, each.linear_acceleration};
      is_whole = node.publish(topic, frame_id_, imu) && is_whole;
    }
    if (!is_whole) losses.add("a subscriber of " + topic + " is slow");
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
  const std::string session_;
  const std::string topic_;
  const std::string frame_id_;
  const CalibratedCameras cameras_;
  const std::vector<wire::StreamDeclaration> streams_;
  std::deque<Message> messages_;
  Pace pace_{settings_.pace};
  asio::steady_timer timer_{the_ros().thread};
  Clock::time_point first_arrival_;
  bool is_begun_ = false;  // nothing waits for the first subscriber any more
  bool is_stereo_ = false;
};

class RosSink final : public FrameSink {
 public:
  RosSink(asio::io_context& main, const SessionInfo& info, const RosSettings& settings)
      : main_(main), stream_(std::make_shared<Stream>(info, settings)) {}

  void async_write(FramePtr frame, Done done) override {
    publish_later({std::move(frame), nullptr});
    asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
  }

  bool takes_items() const override { return true; }
  void async_write_items(ItemsPtr items, Done done) override {
    if (items->stream >= wire::kFirstOther) publish_later({nullptr, std::move(items)});
    asio::post(main_, [done = std::move(done)] { done(std::nullopt); });
  }

  std::uint64_t lost() const override { return stream_->losses.count(); }

 private:
  void publish_later(Stream::Message message) {
    Ros& ros = the_ros();
    if (ros.waiting_bytes + message.bytes() > kMostWaitingBytes) {
      return stream_->losses.add("64 MiB of frames wait for ROS");
    }
    ros.waiting_bytes += message.bytes();
    asio::post(ros.thread,
               [stream = stream_, message = std::move(message)] { stream->add(message); });
  }

  asio::io_context& main_;
  const std::shared_ptr<Stream> stream_;  // shared with what waits on `ros`
};

}  // namespace

std::shared_ptr<FrameSink> make_ros_sink(asio::io_context& main, const SessionInfo& info,
                                         const RosSettings& settings) {
  return std::make_shared<RosSink>(main, info, settings);
}

bool end_ros() {
  const auto ended = std::make_shared<std::promise<void>>();
  asio::post(the_ros().thread, [ended] {
    Ros& ros = the_ros();
    for (const auto& stream : ros.busy) stream->end();
    ros.busy.clear();
    ros.node.close();
    asio::post(ros.thread, [ended] { ended->set_value(); });  // after what the streams log
  });
  return ended->get_future().wait_for(kFarewell) == std::future_status::ready;
}

}  // namespace orbbuf
