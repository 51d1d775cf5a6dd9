// SPDX-License-Identifier: Apache-2.0
// A subscriber that keeps what it hears: `orbbuf-ros-listener FOLDER BASE...` writes each
// BASE/image_raw/compressed as FOLDER/BASE/SECONDS.jpg, and each BASE/camera_info as
// SECONDS.info beside it, and each message of BASE/imu0 as SECONDS.imu. Says `receiving TOPIC` at
// the first message of each.
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Imu.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <set>
#include <string>
#include <vector>

namespace {

namespace fs = std::filesystem;

class Listener {
 public:
  explicit Listener(fs::path folder) : folder_(std::move(folder)) {}

  void listen(const std::string& base) {
    constexpr std::uint32_t kQueued = 1000;
    fs::create_directories(folder_ / base.substr(1));
    const std::string images = base + "/image_raw/compressed";
    subscribers_.push_back(handle_.subscribe<sensor_msgs::CompressedImage>(
        images, kQueued, [this, base, images](const sensor_msgs::CompressedImageConstPtr& image) {
          const std::string bytes(image->data.begin(), image->data.end());
          keep(base, image->header, image->format == "jpeg" ? ".jpg" : ".unknown", bytes);
          say(images);
        }));
    constexpr std::uint32_t kQueuedSamples = 10'000;
    const std::string samples = base + "/imu0";
    subscribers_.push_back(handle_.subscribe<sensor_msgs::Imu>(
        samples, kQueuedSamples, [this, base, samples](const sensor_msgs::ImuConstPtr& imu) {
          std::string text = imu->header.frame_id;
          for (const double value :
               {imu->angular_velocity.x, imu->angular_velocity.y, imu->angular_velocity.z,
                imu->linear_acceleration.x, imu->linear_acceleration.y, imu->linear_acceleration.z,
                imu->orientation_covariance[0]}) {
            text += " " + std::to_string(value);
          }
          keep(base, imu->header, ".imu", text + "\n");
          say(samples);
        }));
    const std::string infos = base + "/camera_info";
    subscribers_.push_back(handle_.subscribe<sensor_msgs::CameraInfo>(
        infos, kQueued, [this, base, infos](const sensor_msgs::CameraInfoConstPtr& info) {
          std::string text = info->header.frame_id + " " + std::to_string(info->width) + "x" +
                             std::to_string(info->height) + " " + info->distortion_model;
          for (const double value : {info->K[0], info->K[4], info->K[2], info->K[5], info->P[3]}) {
            text += " " + std::to_string(value);
          }
          keep(base, info->header, ".info", text + "\n");
          say(infos);
        }));
  }

 private:
  /// Whole at once: somebody may be waiting for it.
  void keep(const std::string& base, const std_msgs::Header& header, const std::string& suffix,
            const std::string& bytes) {
    char stamp[32];
    std::snprintf(stamp, sizeof stamp, "%u.%09u", header.stamp.sec, header.stamp.nsec);
    const fs::path path = folder_ / base.substr(1) / (stamp + suffix);
    std::ofstream(folder_ / "incoming", std::ios::binary) << bytes;
    fs::rename(folder_ / "incoming", path);
  }

  void say(const std::string& topic) {
    if (!heard_.insert(topic).second) return;
    std::printf("receiving %s\n", topic.c_str());
    std::fflush(stdout);
  }

  fs::path folder_;
  ros::NodeHandle handle_;
  std::vector<ros::Subscriber> subscribers_;
  std::set<std::string> heard_;
};

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "orbbuf_ros_listener", ros::init_options::NoRosout);
  Listener listener(argv[1]);
  for (int i = 2; i < argc; ++i) listener.listen(argv[i]);
  ros::spin();
}
