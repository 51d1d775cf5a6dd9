// SPDX-License-Identifier: Apache-2.0
// The paper's baseline in its real form: a folder of orbbuf-world as CompressedImage over roscpp,
// with a queue of L, which drops the oldest. Built only where Debian's libroscpp-dev is installed.
//   send WORLD FPS L   each JPEG when it is due, then ends
//   receive            a line for each image, ID TIME
#include <ros/ros.h>
#include <sensor_msgs/CompressedImage.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>

namespace {

constexpr const char* kTopic = "camera";
constexpr double kDrain = 3;  // seconds at the end for what waits in the queue

sensor_msgs::CompressedImage load(const std::string& world, int id) {
  char name[16];
  std::snprintf(name, sizeof name, "%06d", id);
  std::ifstream file(world + "/images/" + name + ".jpg", std::ios::binary);
  sensor_msgs::CompressedImage image;
  image.format = "jpeg";
  image.header.frame_id = name;
  image.data.assign(std::istreambuf_iterator<char>(file), {});
  return image;
}

void send(const std::string& world, double fps, unsigned queue) {
  ros::NodeHandle node;
  const ros::Publisher publisher = node.advertise<sensor_msgs::CompressedImage>(kTopic, queue);
  while (ros::ok() && publisher.getNumSubscribers() == 0) ros::WallDuration(0.01).sleep();
  int id = 0;
  for (ros::WallRate rate(fps); ros::ok(); rate.sleep()) {
    sensor_msgs::CompressedImage image = load(world, id++);
    if (image.data.empty()) break;
    image.header.stamp = ros::Time::now();
    publisher.publish(image);
  }
  ros::WallDuration(kDrain).sleep();
}

void on_image(const sensor_msgs::CompressedImage::ConstPtr& image) {
  std::printf("%s %.6f\n", image->header.frame_id.c_str(), ros::WallTime::now().toSec());
  std::fflush(stdout);
}

}  // namespace

int main(int argc, char** argv) {
  const std::string mode = argc > 1 ? argv[1] : "";
  ros::init(argc, argv, "orbbuf_" + mode);
  if (mode == "send" && argc == 5) {
    send(argv[2], std::stod(argv[3]), static_cast<unsigned>(std::stoul(argv[4])));
    return EXIT_SUCCESS;
  }
  ros::NodeHandle node;
  const ros::Subscriber subscriber = node.subscribe(kTopic, 1000, on_image);
  ros::spin();
  return EXIT_SUCCESS;
}
