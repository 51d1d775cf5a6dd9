// SPDX-License-Identifier: Apache-2.0
#include "server/sink/ros/ros_node.hpp"

#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <utility>

namespace orbbuf {
namespace {

constexpr std::uint32_t kQueuedMessages = 100;  // of a topic, for each subscriber
constexpr std::int64_t kNsPerSecond = 1'000'000'000;

/// ROS counts seconds from 1970 on in 32 bits, and throws beyond.
ros::Time stamp_of(std::int64_t time_ns) {
  constexpr std::int64_t kLatest = 0xFFFF'FFFFLL * kNsPerSecond;
  const std::int64_t time = std::clamp<std::int64_t>(time_ns, 0, kLatest);
  return {static_cast<std::uint32_t>(time / kNsPerSecond),
          static_cast<std::uint32_t>(time % kNsPerSecond)};
}

}  // namespace

class RosNode::Topics {
 public:
  void publish(const std::string& base, const sensor_msgs::CompressedImage& image) {
    publisher<sensor_msgs::CompressedImage>(base + "/image_raw/compressed").publish(image);
  }
  void publish(const std::string& base, const sensor_msgs::CameraInfo& info) {
    publisher<sensor_msgs::CameraInfo>(base + "/camera_info").publish(info);
  }

 private:
  template <class Message>
  ros::Publisher& publisher(const std::string& topic) {
    const auto known = publishers_.find(topic);
    if (known != publishers_.end()) return known->second;
    return publishers_.emplace(topic, handle_.advertise<Message>(topic, kQueuedMessages))
        .first->second;
  }

  ros::NodeHandle handle_;
  std::map<std::string, ros::Publisher> publishers_;  // by topic
};

RosNode::RosNode() = default;

RosNode::~RosNode() = default;

void RosNode::close() {
  topics_.reset();
  if (std::exchange(is_initialised_, false)) ros::shutdown();
}

void RosNode::publish(const std::string& base, const std::string& frame_id, std::int64_t time_ns,
                      const std::uint8_t* jpeg, std::size_t bytes, const CameraInfo* camera) {
  sensor_msgs::CompressedImage image;
  image.header.stamp = stamp_of(time_ns);
  image.header.frame_id = frame_id;
  image.format = "jpeg";
  image.data.assign(jpeg, jpeg + bytes);
  topics_->publish(base, image);
  if (camera == nullptr) return;
  sensor_msgs::CameraInfo info;
  info.header = image.header;
  info.width = camera->width_px;
  info.height = camera->height_px;
  info.distortion_model = camera->distortion_model;
  info.D = camera->distortion;
  std::copy(camera->k.begin(), camera->k.end(), info.K.begin());
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  std::copy(camera->p.begin(), camera->p.end(), info.P.begin());
  topics_->publish(base, info);
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
      spdlog::warn("ros: no master at {}; frames pass it by", ros::master::getURI());
    }
    return false;
  }
  topics_ = std::make_unique<Topics>();
  spdlog::info("ros: publishing by the master at {}", ros::master::getURI());
  return true;
}

}  // namespace orbbuf
