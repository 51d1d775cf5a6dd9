// SPDX-License-Identifier: Apache-2.0
// The same camera over ROS, as roscpp ships it. Built only where Debian's libroscpp-dev is
// installed.
//   send BYTES FPS   publishes CompressedImage with a queue of 10
//   receive          a line for each image, TIME BYTES
#include <ros/ros.h>
#include <sensor_msgs/CompressedImage.h>

#include <cstdio>
#include <cstdlib>
#include <string>

namespace {

constexpr const char* kTopic = "camera";
constexpr unsigned kQueue = 10;

void send(std::size_t bytes, double fps) {
  ros::NodeHandle node;
  const ros::Publisher publisher = node.advertise<sensor_msgs::CompressedImage>(kTopic, kQueue);
  sensor_msgs::CompressedImage image;
  image.format = "jpeg";
  image.data.assign(bytes, 'x');
  for (ros::Rate rate(fps); ros::ok(); rate.sleep()) {
    image.header.stamp = ros::Time::now();
    publisher.publish(image);
  }
}

void on_image(const sensor_msgs::CompressedImage::ConstPtr& image) {
  std::printf("%.6f %zu\n", ros::WallTime::now().toSec(), image->data.size());
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string mode = argc > 1 ? argv[1] : "";
  ros::init(argc, argv, "orbbuf_" + mode);
  if (mode == "send" && argc == 4) {
    send(std::stoul(argv[2]), std::stod(argv[3]));
    return EXIT_SUCCESS;
  }
  ros::NodeHandle node;
  const ros::Subscriber subscriber = node.subscribe(kTopic, kQueue, on_image);
  ros::spin();
  return EXIT_SUCCESS;
}
