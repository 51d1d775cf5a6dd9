// SPDX-License-Identifier: Apache-2.0
// VINS-Fusion (github.com/HKUST-Aerial-Robotics/VINS-Fusion) on live frames, stereo or mono, and on
// the samples of the robot's inertial sensor, which come with them (docs/samples.md).
//
//   orbbuf-vins-fusion CONFIG TRAJECTORY < frames
//
// CONFIG is VINS-Fusion's YAML file, with `multiple_thread: 0`: with threads it leaves out every
// second frame. TRAJECTORY gets the newest pose after each frame (TUM): the IMU's, or without one
// the left camera's. A frame goes to VINS-Fusion with the next one, since it needs a sample behind
// the frame. It needs a ROS master, for what it publishes.
#include <orbbuf/pipe.h>
#include <ros/ros.h>

#include <cstdio>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <opencv2/core.hpp>

#include "estimator/estimator.h"
#include "estimator/parameters.h"
#include "utility/visualization.h"

namespace {

struct Frame {
  double t = 0;
  cv::Mat left, right;  // right is empty of one camera
};

void feed_samples(const orbbuf_image& image, Estimator& estimator) {
  for (std::size_t i = 0; i < image.sample_count; ++i) {
    const orbbuf_sample& sample = image.samples[i];
    estimator.inputIMU(static_cast<double>(sample.t_ns) * 1e-9,
                       Eigen::Map<const Eigen::Vector3d>(sample.linear_acceleration),
                       Eigen::Map<const Eigen::Vector3d>(sample.angular_velocity));
  }
}

void track(Frame& frame, Estimator& estimator, std::ostream& out) {
  if (frame.left.empty()) return;
  estimator.inputImage(frame.t, frame.left, frame.right);
  frame = {};
  if (estimator.solver_flag != Estimator::NON_LINEAR) return;
  const Eigen::Vector3d p = estimator.Ps[WINDOW_SIZE];
  const Eigen::Quaterniond q(estimator.Rs[WINDOW_SIZE]);
  out << estimator.Headers[WINDOW_SIZE] << ' ' << p[0] << ' ' << p[1] << ' ' << p[2] << ' ' << q.x()
      << ' ' << q.y() << ' ' << q.z() << ' ' << q.w() << std::endl;
}

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "orbbuf_vins_fusion");
  if (argc != 3) {
    std::cerr << "usage: orbbuf-vins-fusion CONFIG TRAJECTORY < frames\n";
    return 2;
  }
  ros::NodeHandle node("~");
  registerPub(node);
  readParameters(argv[1]);
  Estimator estimator;
  estimator.setParameter();
  std::ofstream trajectory(argv[2]);
  trajectory << std::fixed << std::setprecision(9);
  Frame frame;
  orbbuf_reader reader;
  orbbuf_image image;
  int got = 0;
  orbbuf_reader_init(&reader, stdin);
  while ((got = orbbuf_read(&reader, &image)) == 1) {
    feed_samples(image, estimator);
    const cv::Mat pixels(static_cast<int>(image.height), static_cast<int>(image.width), CV_8UC1,
                         const_cast<unsigned char*>(image.data));
    if (image.camera == ORBBUF_RIGHT) {
      frame.right = pixels.clone();
    } else {
      track(frame, estimator, trajectory);  // the one before
      frame.t = image.t;
      frame.left = pixels.clone();
    }
  }
  track(frame, estimator, trajectory);
  if (got < 0) std::cerr << "orbbuf-vins-fusion: " << reader.error << '\n';
  orbbuf_reader_free(&reader);
}
