// SPDX-License-Identifier: Apache-2.0
#include "server/sink/ros/ros_node.hpp"

#include <ros/ros.h>
#include <ros/topic_manager.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <map>
#include <utility>

#include "common/log.hpp"

namespace orbbuf {
namespace {

constexpr std::int64_t kNsPerSecond = 1'000'000'000;
constexpr std::uint32_t kSampleQueue = 60'000;  // a minute at 1 kHz

/// ROS counts seconds from 1970 on in 32 bits, and throws beyond.
ros::Time stamp_of(std::int64_t time_ns) {
  constexpr std::int64_t kLatest = 0xFFFF'FFFFLL * kNsPerSecond;
  const std::int64_t time = std::clamp<std::int64_t>(time_ns, 0, kLatest);
  return {static_cast<std::uint32_t>(time / kNsPerSecond),
          static_cast<std::uint32_t>(time % kNsPerSecond)};
}

/// A topic that knows whether roscpp gives up messages, which roscpp itself does not say.
class Topic {
 public:
  template <class Message>
  static Topic advertise(ros::NodeHandle& handle, const std::string& name, std::uint32_t queue) {
    return {handle.advertise<Message>(name, queue), queue};
  }

  bool has_subscriber() const { return publisher_.getNumSubscribers() > 0; }

  /// As RosNode::publish(). For a subscriber that lags, roscpp has `queue` messages, and one that
  /// it writes.
  template <class Message>
  bool publish(const Message& message) const {
    const bool is_full = static_cast<std::uint32_t>(*waiting_) > queue_;
    const auto serialize = [this, &message] {
      ros::SerializedMessage bytes = ros::serialization::serializeMessage(message);
      ++*waiting_;
      bytes.buf.reset(bytes.buf.get(),
                      [buffer = bytes.buf, waiting = waiting_](const void*) { --*waiting; });
      return bytes;
    };
    ros::SerializedMessage message_of_roscpp;
    ros::TopicManager::instance()->publish(publisher_.getTopic(), serialize, message_of_roscpp);
    return !is_full;
  }

 private:
  Topic(ros::Publisher publisher, std::uint32_t queue)
      : publisher_(std::move(publisher)), queue_(queue) {}

  ros::Publisher publisher_;
  std::uint32_t queue_;
  /// The messages that roscpp has for any subscriber; its threads count down.
  std::shared_ptr<std::atomic<int>> waiting_ = std::make_shared<std::atomic<int>>(0);
};

/// Of one camera.
struct CameraTopics {
  Topic compressed;
  Topic raw;
  Topic info;
};

sensor_msgs::CameraInfo info_of(const CameraInfo& camera) {
  sensor_msgs::CameraInfo info;
  info.width = camera.width_px;
  info.height = camera.height_px;
  info.distortion_model = camera.distortion_model;
  info.D = camera.distortion;
  std::copy(camera.k.begin(), camera.k.end(), info.K.begin());
  std::copy(camera.r.begin(), camera.r.end(), info.R.begin());
  std::copy(camera.p.begin(), camera.p.end(), info.P.begin());
  return info;
}

}  // namespace

class RosNode::Topics {
 public:
  void advertise(const std::string& base, std::uint32_t queue) {
    if (cameras_.count(base) > 0) return;
    cameras_.emplace(
        base,
        CameraTopics{
            Topic::advertise<sensor_msgs::CompressedImage>(handle_, base + "/image_raw/compressed",
                                                           queue),
            Topic::advertise<sensor_msgs::Image>(handle_, base + "/image_raw", queue),
            Topic::advertise<sensor_msgs::CameraInfo>(handle_, base + "/camera_info", queue)});
  }
  const CameraTopics& of(const std::string& base) const { return cameras_.at(base); }

  const Topic& imu(const std::string& name) {
    const auto known = imus_.find(name);
    if (known != imus_.end()) return known->second;
    return imus_.emplace(name, Topic::advertise<sensor_msgs::Imu>(handle_, name, kSampleQueue))
        .first->second;
  }

 private:
  ros::NodeHandle handle_;
  std::map<std::string, CameraTopics> cameras_;  // by the topics' base
  std::map<std::string, Topic> imus_;
};

RosNode::RosNode() = default;

RosNode::~RosNode() = default;

void RosNode::close() {
  topics_.reset();
  if (std::exchange(is_initialised_, false)) ros::shutdown();
}

void RosNode::advertise(const std::string& base, std::uint32_t queue) {
  topics_->advertise(base, queue);
}

bool RosNode::has_image_subscriber(const std::string& base) const {
  return has_raw_subscriber(base) || topics_->of(base).compressed.has_subscriber();
}

bool RosNode::has_raw_subscriber(const std::string& base) const {
  return topics_->of(base).raw.has_subscriber();
}

bool RosNode::publish(const std::string& base, const std::string& frame_id, const RosImage& image) {
  const CameraTopics& topics = topics_->of(base);
  std_msgs::Header header;
  header.stamp = stamp_of(image.time_ns);
  header.frame_id = frame_id;
  bool is_whole = true;
  if (image.camera != nullptr) {
    sensor_msgs::CameraInfo info = info_of(*image.camera);
    info.header = header;
    is_whole = topics.info.publish(info);
  }
  if (image.pixels != nullptr) {
    sensor_msgs::Image raw;
    raw.header = header;
    raw.width = raw.step = image.width_px;
    raw.height = image.height_px;
    raw.encoding = sensor_msgs::image_encodings::MONO8;
    raw.data.assign(image.pixels, image.pixels + std::size_t{image.width_px} * image.height_px);
    is_whole = topics.raw.publish(raw) && is_whole;
  }
  sensor_msgs::CompressedImage compressed;
  compressed.header = header;
  compressed.format = "jpeg";
  compressed.data.assign(image.jpeg, image.jpeg + image.jpeg_bytes);
  return topics.compressed.publish(compressed) && is_whole;
}

void RosNode::advertise_imu(const std::string& topic) { topics_->imu(topic); }

bool RosNode::publish(const std::string& topic, const std::string& frame_id, const RosImu& imu) {
  sensor_msgs::Imu message;
  message.header.stamp = stamp_of(imu.time_ns);
  message.header.frame_id = frame_id;
  message.orientation.w = 1;
  message.orientation_covariance[0] = -1;  // there is none
  message.angular_velocity.x = imu.angular_velocity[0];
  message.angular_velocity.y = imu.angular_velocity[1];
  message.angular_velocity.z = imu.angular_velocity[2];
  message.linear_acceleration.x = imu.linear_acceleration[0];
  message.linear_acceleration.y = imu.linear_acceleration[1];
  message.linear_acceleration.z = imu.linear_acceleration[2];
  return topics_->imu(topic).publish(message);
}

/// Without a master nothing of roscpp is called that would wait for one.
bool RosNode::is_connected() {
  if (topics_) return true;
  const std::int64_t now_ns =
      std::chrono::nanoseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
  if (now_ns < next_look_ns_) return false;
  next_look_ns_ = now_ns + kNsPerSecond;
  if (!std::exchange(is_initialised_, true)) {
    ros::init(ros::M_string(), "orbbuf_server",
              ros::init_options::NoSigintHandler | ros::init_options::NoRosout |
                  ros::init_options::AnonymousName);
    ros::master::setRetryTimeout(ros::WallDuration(1));
  }
  if (!ros::master::check()) {
    if (!std::exchange(is_waiting_, true)) {
      log_warn("ros: no master at {}; frames pass it by", ros::master::getURI());
    }
    return false;
  }
  topics_ = std::make_unique<Topics>();
  log_info("ros: publishing by the master at {}", ros::master::getURI());
  return true;
}

}  // namespace orbbuf
