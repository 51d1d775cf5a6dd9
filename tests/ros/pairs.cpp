// SPDX-License-Identifier: Apache-2.0
// `orbbuf-ros-pairs BASE QUEUE WORK_MS`: a stereo program as ROS 1 has them. Subscribes to the raw
// images of BASE/left and BASE/right with queues of QUEUE messages, works for WORK_MS on each pair,
// and prints for each `pairs COUNT, largest step STEP ms, 150 in TIME ms`, the latter the shortest
// time in which 150 pairs arrived in a row; and to both camera_infos, and prints
// `baseline METRES` once image_geometry has made a stereo camera of them.
#include <image_geometry/stereo_camera_model.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <deque>
#include <map>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace {

class Pairs {
 public:
  Pairs(const std::string& base, std::uint32_t queue, std::chrono::milliseconds work)
      : work_(work) {
    const auto image = [this](const sensor_msgs::ImageConstPtr& it) { add(it); };
    const auto info = [this](const sensor_msgs::CameraInfoConstPtr& it) { add(it); };
    using Image = sensor_msgs::Image;
    using Info = sensor_msgs::CameraInfo;
    for (const auto* side : {"/left", "/right"}) {
      const std::string topic = base + side;
      subscribers_.push_back(handle_.subscribe<Image>(topic + "/image_raw", queue, image));
      subscribers_.push_back(handle_.subscribe<Info>(topic + "/camera_info", queue, info));
    }
  }

 private:
  /// An image whose other one has come makes a pair; one without the other never does.
  void add(const sensor_msgs::ImageConstPtr& image) {
    if (image->encoding != "mono8" || image->width == 0 || image->step != image->width ||
        image->data.size() != std::size_t{image->step} * image->height) {
      std::puts("not a mono8 image");
      std::exit(1);
    }
    const ros::Time stamp = image->header.stamp;
    if (!images_.emplace(stamp, image).second) {
      if (images_.at(stamp)->data == image->data) std::puts("left and right are the same");
      images_.erase(images_.begin(), images_.upper_bound(stamp));
      if (count_++ > 0) largest_step_ = std::max(largest_step_, stamp - last_);
      last_ = stamp;
      arrivals_.push_back(ros::WallTime::now());
      if (arrivals_.size() > kInARow) {
        shortest_ = std::min(shortest_, arrivals_.back() - arrivals_.front());
        arrivals_.pop_front();
      }
      std::printf("pairs %d, largest step %.0f ms, 150 in %.0f ms\n", count_,
                  largest_step_.toSec() * 1e3, shortest_.toSec() * 1e3);
      std::fflush(stdout);
      std::this_thread::sleep_for(work_);
    }
  }

  void add(const sensor_msgs::CameraInfoConstPtr& info) {
    const auto [other, is_first] = infos_.emplace(info->header.stamp, info);
    if (is_first) return;
    if (!std::exchange(has_model_, true)) {
      const bool is_right = info->P[3] < 0;
      image_geometry::StereoCameraModel model;
      model.fromCameraInfo(is_right ? other->second : info, is_right ? info : other->second);
      std::printf("baseline %.3f\n", model.baseline());
      std::fflush(stdout);
    }
    infos_.clear();
  }

  static constexpr std::size_t kInARow = 150;

  const std::chrono::milliseconds work_;
  ros::NodeHandle handle_;
  std::vector<ros::Subscriber> subscribers_;
  std::map<ros::Time, sensor_msgs::ImageConstPtr> images_;  // that lack the other one
  std::map<ros::Time, sensor_msgs::CameraInfoConstPtr> infos_;
  bool has_model_ = false;
  int count_ = 0;
  ros::Time last_;
  ros::Duration largest_step_;
  std::deque<ros::WallTime> arrivals_;  // of the last pairs
  ros::WallDuration shortest_{1000};
};

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "orbbuf_ros_pairs",
            ros::init_options::NoRosout | ros::init_options::AnonymousName);
  const Pairs pairs(argv[1], static_cast<std::uint32_t>(std::atoi(argv[2])),
                    std::chrono::milliseconds(std::atoi(argv[3])));
  ros::spin();
}
