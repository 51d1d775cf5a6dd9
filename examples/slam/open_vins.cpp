// SPDX-License-Identifier: Apache-2.0
// OpenVINS (github.com/rpng/open_vins, built without ROS) on live frames, mono or stereo, and on
// the samples of the robot's inertial sensor, which come with them (docs/samples.md).
//
//   orbbuf-open-vins CONFIG TRAJECTORY < frames
//
// CONFIG is OpenVINS's estimator_config.yaml. TRAJECTORY gets the IMU's pose after each frame
// (TUM). A frame goes to OpenVINS with the next one, since its filter needs a sample behind the
// frame.
#include <core/VioManager.h>
#include <core/VioManagerOptions.h>
#include <orbbuf/pipe.h>
#include <state/State.h>
#include <utils/opencv_yaml_parse.h>
#include <utils/sensor_data.h>

#include <cstdio>
#include <fstream>
#include <iomanip>
#include <iostream>
#include <memory>
#include <opencv2/core.hpp>
#include <string>

namespace {

void feed_samples(const orbbuf_image& image, ov_msckf::VioManager& vio) {
  for (std::size_t i = 0; i < image.sample_count; ++i) {
    const orbbuf_sample& sample = image.samples[i];
    ov_core::ImuData imu;
    imu.timestamp = static_cast<double>(sample.t_ns) * 1e-9;
    imu.wm = Eigen::Map<const Eigen::Vector3d>(sample.angular_velocity);
    imu.am = Eigen::Map<const Eigen::Vector3d>(sample.linear_acceleration);
    vio.feed_measurement_imu(imu);
  }
}

void write_pose(std::ostream& out, ov_msckf::VioManager& vio) {
  if (!vio.initialized()) return;
  const auto state = vio.get_state();
  const auto p = state->_imu->pos();
  const auto q = state->_imu->quat();  // JPL, world to IMU: the numbers of Hamilton's IMU to world
  out << state->_timestamp << ' ' << p[0] << ' ' << p[1] << ' ' << p[2] << ' ' << q[0] << ' '
      << q[1] << ' ' << q[2] << ' ' << q[3] << std::endl;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    std::cerr << "usage: orbbuf-open-vins CONFIG TRAJECTORY < frames\n";
    return 2;
  }
  const auto parser = std::make_shared<ov_core::YamlParser>(argv[1]);
  ov_msckf::VioManagerOptions options;
  options.print_and_load(parser);
  if (!parser->successful()) return 2;
  ov_msckf::VioManager vio(options);
  std::ofstream trajectory(argv[2]);
  trajectory << std::fixed << std::setprecision(9);
  ov_core::CameraData frame;
  orbbuf_reader reader;
  orbbuf_image image;
  int got = 0;
  orbbuf_reader_init(&reader, stdin);
  while ((got = orbbuf_read(&reader, &image)) == 1) {
    feed_samples(image, vio);
    const int id = image.camera == ORBBUF_RIGHT ? 1 : 0;
    if (id == 0) {
      if (!frame.images.empty()) {
        vio.feed_measurement_camera(frame);
        write_pose(trajectory, vio);
      }
      frame = {};
    }
    frame.timestamp = image.t;
    frame.sensor_ids.push_back(id);
    const cv::Mat pixels(static_cast<int>(image.height), static_cast<int>(image.width), CV_8UC1,
                         const_cast<unsigned char*>(image.data));
    frame.images.push_back(pixels.clone());
    frame.masks.push_back(cv::Mat::zeros(pixels.size(), CV_8UC1));
  }
  if (got < 0) std::cerr << "orbbuf-open-vins: " << reader.error << '\n';
  orbbuf_reader_free(&reader);
}
