// SPDX-License-Identifier: Apache-2.0
// Frames over ROS 1, as roscpp ships it: send QUEUE | receive QUEUE; a queue of 0 has no bound.
#include <ros/ros.h>
#include <sensor_msgs/CompressedImage.h>

#include <string>

#include "bench/rivals/peers/messages.hpp"

namespace {

void on_image(const sensor_msgs::CompressedImage::ConstPtr& image) {
  orbbuf::bench::print_arrival(image->data.data(), image->data.size());
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 3) return 2;
  const std::string mode = argv[1];
  const auto queue = static_cast<std::uint32_t>(std::stoul(argv[2]));
  ros::init(argc, argv, "rival_" + mode);
  ros::NodeHandle node;
  if (mode == "receive") {
    const ros::Subscriber subscriber = node.subscribe("camera", queue, on_image);
    ros::spin();
    return EXIT_SUCCESS;
  }
  const ros::Publisher publisher = node.advertise<sensor_msgs::CompressedImage>("camera", queue);
  sensor_msgs::CompressedImage image;
  image.format = "jpeg";
  while (ros::ok()) {
    image.data = orbbuf::bench::next_message();
    image.header.stamp = ros::Time::now();
    publisher.publish(image);
  }
  return EXIT_SUCCESS;
}
